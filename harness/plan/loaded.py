"""The engines and scenes of an experiment, loaded once: every mistake in a name is found before anything runs."""

from __future__ import annotations

from dataclasses import replace

from engines.choices import Choice
from engines.errors import ConfigError, RaybenchError, UnknownName
from engines.interface import Engine
from engines.registry import engine as engine_of
from engines.scene import Scene
from harness.config import Experiment
from harness.config.sections import AUTOMATIC, REFERENCE_ENGINE, makes_references
from harness.config.settings import Combination, SceneFile
from harness.plan import answers
from harness.plan.cells import flow
from harness.plan.names import names_of
from harness.settings import completed, require_commands, require_imports
from harness.source_hashes import engine_code


class Loaded:
    """Every engine and scene that an experiment names."""

    def __init__(self, experiment: Experiment, allow_imports: bool, allow_commands: bool, allow_outside: bool) -> None:
        self.allow_imports, self.allow_outside, self._source = allow_imports, allow_outside, experiment.source
        names = dict.fromkeys(combination.engine for combination in experiment.combinations)
        self.engines: dict[str, Engine] = {}
        reference = experiment.reference
        certify = None if reference.certify == AUTOMATIC else reference.certify
        self.reference_engine = reference.engine or REFERENCE_ENGINE
        self.in_its_place = [] if reference.engine else [n for n in names if n != REFERENCE_ENGINE and makes_references(n)]
        for name in filter(None, [*names, *((self.reference_engine, certify) if experiment.renders else ())]):
            require_imports(name, allow_imports)
            require_commands(name, allow_commands)
            answers.accelerators(self.engines.setdefault(name, engine_of(name)))  # raises: it cannot list them
        self.names = names_of(self.engines)
        self.candidates: dict[str, Engine | None] = {}
        self._codes: dict[str, str] = {}
        files = dict.fromkeys(self.file(combination) for combination in experiment.combinations)
        self.scenes: dict[SceneFile, Scene] = {file: file.load(allow_imports) for file in files}

    def file(self, combination: Combination) -> SceneFile:
        """The scene's file, as it may be read."""
        return replace(combination.scene, allow_outside=self.allow_outside)

    def code(self, name: str) -> str:
        """The hash of an engine's code."""
        if name not in self._codes:
            engine = self.candidate(name)
            assert engine is not None
            self._codes[name] = engine_code(engine, name)
        return self._codes[name]

    def candidate(self, name: str) -> Engine | None:
        """An engine, whether or not the experiment names it; None where it cannot be loaded."""
        if name in self.engines:
            return self.engines[name]
        if name not in self.candidates:
            try:
                self.candidates[name] = engine_of(name)
            except RaybenchError:
                self.candidates[name] = None
        return self.candidates[name]

    def completed(self, kind: str, given: Choice) -> Choice:
        """A choice with all options of the plugin that it names. Raises `ConfigError` with the experiment's file."""
        try:
            return completed(kind, given, self.allow_imports)
        except RaybenchError as error:
            raise ConfigError(f"{self._source}: {error}") from error

    def accelerator(self, name: str, given: Choice) -> tuple[Choice, str | None]:
        """The accelerator with its options, and why the engine has none such. Unknown to all engines is an error."""
        if ":" in given.name:
            return self.completed("accelerator", given), None
        if answers.resolves(self.engines[name], given):
            return answers.resolved(self.engines[name], given), None
        if any(answers.resolves(other, given) for other in self.engines.values()):
            return given, f"the engine {name} has no accelerator {flow(given)}"
        for other in self.engines.values():
            if given.name in answers.accelerators(other):
                answers.resolved(other, given)  # raises: it knows the name, but not the options
        raise UnknownName("accelerator", given.name, {a for e in self.engines.values() for a in answers.accelerators(e)})
