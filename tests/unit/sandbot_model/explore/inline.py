"""Workers that need no process."""

from concurrent.futures import Executor, Future


class Inline(Executor):
    """Does the work at once, in this process."""

    def submit(self, function, /, *arguments, **named):
        future = Future()
        try:
            future.set_result(function(*arguments, **named))
        except Exception as error:
            future.set_exception(error)
        return future
