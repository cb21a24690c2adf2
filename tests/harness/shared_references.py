"""A process of `test_references_shared`: makes the same small references as its siblings, at the same time.

    python shared_references.py FOLDER NUMBER ROUNDS

Images are known and come from this process, so that nothing but the files is slow.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from time import sleep, time
from typing import Any

import numpy as np

from engines.choices import Choice
from engines.film import Film
from harness.config.settings import SceneFile
from harness.run import references
from harness.settings import CellSettings
from harness.store import reference_files

REPLICATES = 6
SETTINGS = CellSettings(Choice("auto", {}), "float64", 1, Choice("albedo", {}), Choice("random", {}), 24, 16)


def wanted(number: int, replicates: int = REPLICATES) -> references.PlannedReference:
    asked = {
        "scene": "s",
        "replicates": replicates,
        "replicate_spp": 4,
        "engine": "fake",
        "width": 24,
        "height": 16,
        "shader": {"name": "albedo"},
        "seed": 100 * number,
    }
    return references.PlannedReference(SceneFile("ball", "ball.yaml"), "5ce4e", asked, SETTINGS)


def image(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random((16, 24, 3))


class Images:
    """The image under each seed, after a moment."""

    def replicates(self, engine: str, request: Mapping[str, Any], seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        for seed in seeds:
            film = Film(24, 16)
            film.add(image(seed))
            sleep(0.001 * (seed % 3))
            yield film, 0.001


def main() -> None:
    folder, number, rounds = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    references.SAVE_EVERY_SECONDS = 0.0  # every replicate is saved: as many chances to disturb each other as there can be
    (folder / f"ready-{number}").touch()
    while not (folder / "go").exists():
        sleep(0.001)
    began = time()
    for each in range(rounds):
        # Half of the processes ask for fewer samples: they read films that others are extending.
        asked = wanted(each, REPLICATES - 2 * (number % 2))
        references.make(asked, folder / "kept", Images(), lambda done, count: None)
        assert references.ready(asked, folder / "kept")
        told = reference_files.read(asked.folder(folder / "kept"), asked.reference_id, asked.scene_hash)
        expected = np.mean([image(asked.spec["seed"] + i) for i in range(asked.spec["replicates"])], axis=0)
        assert np.allclose(told.mean, expected)
    print(f"{time() - began:.2f} s")


if __name__ == "__main__":
    main()
