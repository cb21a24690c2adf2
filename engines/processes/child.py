"""What a process runs that `engines.processes.process` starts: a script, so that nothing is imported before the function asks
for it. It may have the Python of another environment: the package `engines` is found where this file lies, nothing else of
the folders here is put on that Python's path, and nothing need be installed there.
"""

import importlib
import importlib.util
import os
import signal
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
_PR_SET_PDEATHSIG = 1


class Engines:
    """Finds the package `engines` beside this file."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        """The module spec of `engines`; None for other names."""
        if name != "engines":
            return None
        folder = os.path.dirname(HERE)
        return importlib.util.spec_from_file_location(
            name, os.path.join(folder, "__init__.py"), submodule_search_locations=[folder]
        )


def die_with_parent():
    """Asks Linux to kill this process when the thread that started it is gone: no orphan disturbs the next run."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def run(target, parent, dies_with_it, descriptors, arguments):
    """Calls the function `target`, module:function, with descriptors of sockets and texts, as a child of process `parent`.

    It ends with the parent where it `dies_with_it`, and ignores Ctrl-C, which is for the parent.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if dies_with_it:
        die_with_parent()
        if os.getppid() != parent:
            os._exit(0)
    module, _, function = target.partition(":")
    try:
        called = getattr(importlib.import_module(module), function)
    except ImportError as error:
        sys.exit(f"{type(error).__name__}: {error}")
    called(descriptors, arguments)


def main():
    """Calls the function that the command line names: target, parent's pid, 0 or 1, descriptors, texts."""
    major, minor = sys.version_info[:2]
    if (major, minor) < (3, 11):
        sys.exit(f"Python 3.11 or later is expected, this is {major}.{minor}")
    sys.path[:] = [folder for folder in sys.path if folder != HERE]
    sys.meta_path.insert(0, Engines)
    target, parent, dies_with_it, descriptors, *arguments = sys.argv[1:]
    run(target, int(parent), dies_with_it == "1", [*map(int, descriptors.split(","))], arguments)


if __name__ == "__main__":
    main()
