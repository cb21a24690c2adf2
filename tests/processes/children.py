"""What the processes of `test_processes` run."""

import os
import signal
import subprocess
import sys
import time

from engines.processes import Channel, pickled


def echo(descriptors, arguments):
    """Prints to wherever engines print, and answers with its arguments and what it receives."""
    channel = Channel.at(descriptors[0])
    print("to stdout", flush=True)
    os.write(2, b"to stderr\n\n")
    pickled.send(channel, (arguments, pickled.receive(channel)))


def end(descriptors, arguments):
    """Ends by a status or a signal."""
    os.write(2, b"the last words\n")
    status = int(arguments[0])
    if status < 0:
        os.kill(os.getpid(), -status)
    sys.exit(status)


def close(descriptors, arguments):
    """Closes its sockets and goes on."""
    for descriptor in descriptors:
        os.close(descriptor)
    time.sleep(600)


def start_another(descriptors, arguments):
    """Sends the id of a process that it has started, which has no end of the channel, and then ends or goes on."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    channel = Channel.at(descriptors[0])
    other = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], close_fds=False)
    pickled.send(channel, other.pid)
    time.sleep(float(arguments[0]))


def write(descriptors, arguments):
    """Writes bytes that are no message, and waits."""
    os.write(descriptors[0], bytes.fromhex(arguments[0]))
    time.sleep(600)
