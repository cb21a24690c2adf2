"""Results on disk: the events and the folder they lie in, under one name.

Their types are in `records`, the checks of what is read in `validation`; `results` arranges them for tables and plots, `merge`
joins folders, and `reference_files` finds and reads the references that they name.
"""

from harness.store.events import (
    EVENTS,
    MANIFEST,
    TORN,
    Events,
    check_results,
    compress,
    events_file,
    last_event,
    latest_cells,
    latest_verify_jobs,
    of_kind,
    read_events,
)
from harness.store.folder import (
    DERIVED,
    IMAGES,
    LOCK,
    SENTENCES,
    WINNERS,
    clear,
    config_of,
    derived_is_fresh,
    discard_images,
    image_file,
    image_path,
    is_locked,
    locked,
    make_out,
    read_manifest,
    write_manifest,
)
from harness.store.json_files import read_json, write_json
from harness.store.reference_files import reference_arrays
