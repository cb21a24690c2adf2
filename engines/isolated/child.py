"""Started by `engines.isolated.process` with the Python of an engine's environment: finds raybench's package `engines` where
this file lies, and serves. Nothing else of the folders here is put on that Python's path, nor need anything be installed there.
"""

import importlib.util
import os
import sys


def main():
    major, minor = sys.version_info[:2]
    if (major, minor) < (3, 11):
        sys.exit(f"Python 3.11 or later is expected, this is {major}.{minor}")
    del sys.path[0]  # the folder of this file
    folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    spec = importlib.util.spec_from_file_location(
        "engines", os.path.join(folder, "__init__.py"), submodule_search_locations=[folder]
    )
    assert spec is not None and spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules["engines"] = package
    try:
        spec.loader.exec_module(package)
        from engines.isolated.server import serve
    except ImportError as error:
        sys.exit(f"{type(error).__name__}: {error}")
    parent, dies_with_it, *descriptors = map(int, sys.argv[1:])
    serve(parent, bool(dies_with_it), *descriptors)


main()
