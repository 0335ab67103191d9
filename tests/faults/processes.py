"""A node as a process of its own, for who freezes or kills it."""

import contextlib
import signal
import subprocess
import sys


def running(module, *given, **options):
    """A node as a process; ended when the test ends, if it has not been before."""
    parameters = [word for one in given for word in ("-p", one)]
    command = [sys.executable, "-m", module, "--ros-args", *parameters]
    return ending(subprocess.Popen(command, stderr=subprocess.PIPE, text=True, **options))


@contextlib.contextmanager
def ending(process):
    """A process, ended at the end, a frozen one as well."""
    try:
        yield process
    finally:
        process.send_signal(signal.SIGCONT)
        process.terminate()
        process.communicate(timeout=60)
