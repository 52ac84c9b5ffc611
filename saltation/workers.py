"""Worker processes: one that is killed is replaced and its task done again, and none outlives this process."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import queue
import signal
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any

REPLACEMENTS = 10  # of killed workers; more have a common cause, such as a lack of memory


class Processes(Executor):
    """An executor like `ProcessPoolExecutor` that survives the death of its workers.

    Each worker is at the end of a pipe of its own, so when one is killed, even while it answers, only its task is lost.
    After `replacements` killed workers a task whose worker is killed ends with `BrokenExecutor`.

    >>> with processes(1) as pool:
    ...     pool.submit(pow, 2, 10).result()
    1024
    """

    def __init__(self, workers: int, replacements: int = REPLACEMENTS) -> None:
        self._left = replacements
        self._lock = threading.Lock()
        self._over = False
        self._tasks: queue.SimpleQueue[tuple[Future[Any], Any] | None] = queue.SimpleQueue()
        with ignore_sigint():  # inherited by the workers from their first line on
            self._workers = [_start() for _ in range(workers)]
        self._threads = [threading.Thread(target=self._serve, args=(number,), daemon=True) for number in range(workers)]
        for thread in self._threads:
            thread.start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Have a function of a module, which a worker can find, called by a worker; its arguments are pickled. RuntimeError after `shutdown`."""
        if self._over:
            raise RuntimeError("cannot schedule new futures after shutdown")
        future: Future[Any] = Future()
        self._tasks.put((future, (fn, args, kwargs)))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """No more tasks; the workers end when theirs are done."""
        self._over = True
        while cancel_futures:
            try:
                task = self._tasks.get_nowait()
            except queue.Empty:
                break
            if task is not None:
                task[0].cancel()
        for _ in self._threads:
            self._tasks.put(None)
        for thread in self._threads if wait else ():
            thread.join()

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> bool | None:
        """After an error or an interrupt the workers end at once."""
        with ignore_sigint():
            if kind is not None:
                with self._lock:
                    self._over = True
                    for process, _ in self._workers:
                        process.kill()
            self.shutdown(cancel_futures=kind is not None)
        return None

    def _serve(self, number: int) -> None:
        """Hand tasks to one worker and its successors, one after the other."""
        while (task := self._tasks.get()) is not None:
            future, work = task
            if not future.set_running_or_notify_cancel():
                continue
            while True:
                process, pipe = self._workers[number]
                try:
                    pipe.send(work)
                    good, answer = pipe.recv()
                except (EOFError, OSError):  # it is dead
                    good, answer = False, None
                except Exception as failure:  # what cannot be sent
                    good, answer = False, failure
                if good:
                    future.set_result(answer)
                elif answer is not None:
                    future.set_exception(answer)
                elif self._replaced(number):
                    continue
                else:
                    future.set_exception(BrokenExecutor("too many workers were killed"))
                break
        process, pipe = self._workers[number]
        pipe.close()
        process.join()

    def _replaced(self, number: int) -> bool:
        """Whether there is another worker in the place of one that is dead."""
        process, pipe = self._workers[number]
        pipe.close()
        process.join()
        with self._lock:
            if self._over or not self._left:
                return False
            self._left -= 1
            self._workers[number] = _start()
        return True


class SerialExecutor(Executor):
    """An executor that does each task at once, in this process: for callers that must not start others.

    >>> SerialExecutor().submit(pow, 2, 10).result()
    1024
    """

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Call a function: a future that is done, with the result or the error."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


def processes(workers: int | None = None) -> Processes:
    """Processes (default: one per core) that end with the `with` that holds them: at an error, an interrupt, or when this process is killed."""
    return Processes(workers or cores())


def cores() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _start() -> tuple[Any, Connection]:
    """A worker and this process's end of its pipe."""
    context = multiprocessing.get_context("spawn")
    ours, its = context.Pipe()
    process = context.Process(target=_work, args=(its,), daemon=True)
    process.start()
    its.close()
    return process, ours


def _work(pipe: Connection) -> None:
    """A worker: one answer, (True, value) or (False, error), per task; ends when the other end of the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # interrupts are the parent's
    tasks: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def listen() -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                tasks.put(pipe.recv())
        os._exit(1)  # the parent closed the pipe or is dead: also during a task

    threading.Thread(target=listen, daemon=True).start()
    while True:
        function, args, kwargs = tasks.get()
        try:
            answer = True, function(*args, **kwargs)
        except Exception as error:
            error.add_note(traceback.format_exc())
            answer = False, error
        try:
            pipe.send(answer)
        except OSError:
            return
        except Exception as error:  # what cannot be sent
            pipe.send((False, RuntimeError(f"a worker's answer cannot be sent: {error}")))


@contextlib.contextmanager
def ignore_sigint() -> Iterator[None]:
    """Interrupts are ignored; where signals cannot be set (not the main thread) nothing happens."""
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
