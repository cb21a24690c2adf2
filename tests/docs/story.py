"""Runs a page in the folder it is called from; `tests.docs.blocks` has the rules."""

import contextlib
import io
import os
import shlex
import subprocess
import sys
import types
from pathlib import Path

from tests import forked
from tests.docs.blocks import ROOT, Block, blocks, commands, missing

SCENE = {
    "raybench_scene": 1,
    "camera": {"type": "perspective", "eye": [0, 0, 4], "target": [0, 0, 0], "fov": 40, "resolution": [48, 32]},
    "materials": {"grey": {"kd": 0.5}},
    "shapes": [{"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "grey"}],
    "lights": [{"environment": {"radiance": [1, 1, 1]}}],
}
EXPERIMENT = {"raybench_experiment": 1, "scene": "cornell_box", "engine": "numba"}


def main(page: Path) -> None:
    """Raises where something on the page does not work, or prints something else than the page shows."""
    found = blocks(page.read_text(encoding="utf-8"))
    for block in found:
        if block.file:
            Path(block.file).parent.mkdir(parents=True, exist_ok=True)
            Path(block.file).write_text(block.body, encoding="utf-8")
    sys.path.insert(0, os.getcwd())
    module = types.ModuleType("page")
    sys.modules["page"] = module
    printed = ""
    for number, block in enumerate(found):
        here = f"{page.name}:{block.line}"
        if block.language == "text" and block.words == ("printed",):
            lacking = missing(tuple(line for line in block.body.splitlines() if line.strip()), printed)
            assert lacking is None, f"{here}: {lacking!r} was not printed, but\n{printed}"
        elif not block.runs or (block.language == "python" and block.file):
            continue
        elif block.language == "python":
            printed = python(block, module, f"{page.stem}_{number}.py")
        elif block.language == "console":
            printed = console(block, here)
        else:
            read(block, here)


def python(block: Block, module: types.ModuleType, name: str) -> str:
    """Runs a block among the names of `module`, with the page's lines in tracebacks; returns what it prints."""
    source = "\n" * (block.line - 1) + block.body
    Path(name).write_text(source, encoding="utf-8")
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(source, name, "exec"), module.__dict__)
    return out.getvalue()


def console(block: Block, here: str) -> str:
    """Runs the commands of a block; returns what they print."""
    words, wanted, added = block.words, 0, ""
    if words[:1] == ("exit",):
        words, wanted = words[2:], int(words[1])
    if words[:1] == ("with",):
        added = " " + " ".join(words[1:])
    everything = ""
    for command in commands(block):
        line = command.text.partition("  #")[0] + added
        code, shown = run(line)
        everything += shown
        context = f"{here}: $ {line}\n{shown[-4000:]}"
        assert code == wanted, f"exit code {code}: {context}"
        lacking = missing(command.output, shown)
        assert lacking is None, f"{lacking!r} was not printed: {context}"
    return everything


def run(line: str) -> tuple[int, str]:
    """Exit code and output of a line: `raybench` and its arguments in a process of its own, anything else in a shell."""
    words = shlex.split(line)
    if words[0] != "raybench" or set(line) & set("|<>&;*"):
        done = subprocess.run(
            line, shell=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )
        return done.returncode, done.stdout
    done = forked.raybench(words[1:], None, os.environ, merged=True)
    return done.returncode, done.stdout


def read(block: Block, here: str) -> None:
    """Loads the scene, experiment or renderer's file of a yaml block."""
    import yaml

    import engines
    from engines.peers.external.description import read as read_renderer
    from harness import config

    given = yaml.safe_load(block.body)
    base = {("scene",): SCENE, ("experiment",): EXPERIMENT}.get(block.words, {})
    axes = {**given.get("matrix", {}), **given.get("zip", {})} if base is EXPERIMENT else {}
    whole = {**{key: value for key, value in base.items() if key not in axes}, **given}
    if base is SCENE:
        whole["materials"] = {**SCENE["materials"], **given.get("materials", {})}
    file = Path(block.file or f"piece_{block.line}.yaml")
    if not block.file:
        file.write_text(yaml.safe_dump(whole, sort_keys=False) if base else block.body, encoding="utf-8")
    if "raybench_scene" in whole:
        engines.load_scene(file, allow_imports=True)
    elif "raybench_experiment" in whole:
        config.load(file)
    elif "raybench_renderer" in whole:
        read_renderer(file)
    else:
        raise AssertionError(f"{here}: a piece of a scene or of an experiment? Say `yaml scene` or `yaml experiment`")


def environment(folder: Path) -> dict[str, str]:
    """The environment of a reader: our `raybench` and `python` come first, and `folder` can be imported from."""
    tools = folder / ".bin"
    tools.mkdir()
    for name, arguments in (("raybench", "-m harness "), ("python", "")):
        (tools / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments}"$@"\n')
        (tools / name).chmod(0o755)
    path = os.pathsep.join([str(tools), os.environ.get("PATH", "")])
    python_path = os.pathsep.join([str(folder), str(ROOT)])
    plain = {"MPLBACKEND": "Agg", "COLUMNS": "160", "NO_COLOR": "1"}
    return {**os.environ, **plain, "PATH": path, "PYTHONPATH": python_path}
