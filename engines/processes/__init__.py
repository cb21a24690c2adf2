"""Processes that run a function of ours, and the channels to them: for workers that measure, verify and show, and for engines
in processes of their own.

`process` starts and ends a process, `child` is what it runs, `channel` carries messages. These are records of plain data,
which are checked as they arrive since an engine may write anything (`records`), or pickled objects (`pickled`).
"""

from engines.processes.channel import BadMessage, Channel, Closed
from engines.processes.process import Process, status_in_words

__all__ = ["BadMessage", "Channel", "Closed", "Process", "status_in_words"]
