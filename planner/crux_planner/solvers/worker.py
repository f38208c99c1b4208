"""Another process that calls functions for this one: the only way in which the planner starts processes.

A worker is a fresh interpreter, fork and exec in one: no lock of a thread of this process is held in it, and the
caller's main module is not run again. It imports what it is told to while this process goes on, calls one function
after another, prints nothing, and ends when it is stopped or when this process ends, however that happens.
"""

from __future__ import annotations

import importlib
import itertools
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from multiprocessing.connection import Connection, Pipe
from typing import Any, Generic, TypeVar

Log = Callable[[str], None]
Answer = TypeVar("Answer")

LIVE: set[int] = set()  # process ids of the workers that run
ENDED_S: list[float] = []  # what each worker that has ended computed [s]


class WorkerLostError(Exception):
    """The process of a worker has ended by itself; str() says how."""


class Worker:
    """One such process, which imports `modules` to begin with; `log` reports it if it is lost. It starts in `with`, or
    where not `at_once`, when it is asked for something.
    """

    def __init__(self, *modules: str, log: Log = lambda _line: None, at_once: bool = True) -> None:
        self._modules, self._log, self._at_once = modules, log, at_once
        self._link: Connection | None = None
        self.process: subprocess.Popen[bytes] | None = None
        self.waiting = 0  # calls begun whose results are not received yet
        self.lost = False  # it is not started again

    def __enter__(self) -> Worker:
        if self._at_once:
            self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()

    def start(self) -> None:
        """Start the process where it does not run."""
        if self.process is not None or self.lost:
            return
        self._link, theirs = Pipe()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-P", __file__, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )
        LIVE.add(self.process.pid)
        self._send((sys.path, self._modules))

    def begin(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Have the process call a function of some module; what it returns is to be received."""
        self.start()
        self.waiting += 1
        self._send((function, arguments))

    def receive(self) -> Any:
        """The next value: what a function says (`say`) or, last, what it returns.

        Raises what the function raises, and WorkerLostError.
        """
        try:
            if self._link is None:
                raise EOFError
            last, ok, value = self._link.recv()
        except (EOFError, OSError):
            self.waiting = 0
            raise WorkerLostError(self._lose()) from None
        self.waiting -= last
        if not ok:
            raise value
        return value

    def ready(self, within_s: float) -> bool:
        """Whether there is something to receive, or comes within so many seconds; also that the process is lost."""
        try:
            return self._link is None or self._link.poll(None if within_s == float("inf") else max(within_s, 0.0))
        except OSError:
            return True

    @property
    def pid(self) -> int | None:
        """Of the process, where it runs."""
        return None if self.process is None else self.process.pid

    def stop(self) -> None:
        """End the process, whatever it is doing; the next call starts another one."""
        if self.process is not None and self._link is not None:
            self.process.kill()
            self._wait(self.process)
            self._link.close()
        self.process = self._link = None
        self.waiting = 0

    @staticmethod
    def _wait(process: subprocess.Popen[bytes]) -> int:
        """How a process ended. Not by Popen.wait, which does not tell what it computed."""
        if process.returncode is None:
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            LIVE.discard(process.pid)
            ENDED_S.append(used.ru_utime + used.ru_stime)
        return process.returncode

    def _send(self, message: Any) -> None:
        try:
            if self._link is not None:
                self._link.send(message)
        except OSError:  # it is lost, which whoever receives from it will learn
            pass

    def _lose(self) -> str:
        """How the process ended; said the first time."""
        how = "ended"
        if self.process is not None:
            status = self._wait(self.process)
            how = f"ended by signal {-status}" if status < 0 else f"ended with status {status}"
        if not self.lost:
            self._log(f"a worker process {how}; planning goes on without it")
        self.lost = True
        self.stop()
        return how


def spare_cores() -> int:
    """Cores that this process may use beside its own."""
    return len(os.sched_getaffinity(0)) - 1


@contextmanager
def crew(most: int, *modules: str, log: Log = lambda _line: None) -> Iterator[list[Worker]]:
    """Workers, as many as there are spare cores and at most so many."""
    with ExitStack() as stack:
        yield [stack.enter_context(Worker(*modules, log=log)) for _ in range(min(most, spare_cores()))]


class Team(Generic[Answer]):
    """Calls of one object, made once by `make(*arguments)` here and in every worker, shared among them.

    Workers that are busy with something else are left alone, and what a lost one owes is worked out here.
    """

    def __init__(self, workers: Sequence[Worker], make: Callable[..., Callable[..., Answer]], *arguments: Any) -> None:
        self._workers, self._make, self._arguments = workers, make, arguments
        self._key = next(_KEYS)
        self._own: Callable[..., Answer] | None = None
        self._known: dict[Worker, subprocess.Popen[bytes] | None] = {}  # the processes that have the object

    def free(self) -> list[Worker]:
        """The workers that can take a call at once."""
        return [worker for worker in self._workers if not worker.waiting and not worker.lost]

    def call(self, *question: Any) -> Answer:
        """The answer of this process."""
        if self._own is None:
            self._own = self._make(*self._arguments)
        return self._own(*question)

    def later(self, worker: Worker, *question: Any) -> Callable[[], Answer]:
        """Begin with a call; gives its answer when called, in the order of the calls of a worker."""
        worker.start()
        known = self._known.get(worker) is worker.process
        self._known[worker] = worker.process
        worker.begin(_answer, self._key, None if known else (self._make, self._arguments), question)

        def answer() -> Answer:
            try:
                received: Answer = worker.receive()
            except WorkerLostError:
                return self.call(*question)
            return received

        return answer

    def answers(self, questions: Sequence[tuple[Any, ...]]) -> list[Answer]:
        """The answers to all, in their order."""
        free = self.free()
        share = len(free) + 1
        begun = {i: self.later(free[i % share - 1], *question) for i, question in enumerate(questions) if i % share}
        try:
            own = {i: self.call(*question) for i, question in enumerate(questions) if i not in begun}
            return [own[i] if i in own else begun[i]() for i in range(len(questions))]
        finally:
            for worker in free:  # nobody receives what is left where a call has failed
                if worker.waiting:
                    worker.stop()


_KEYS = itertools.count()

# What follows is the worker's own side.
_KEPT: dict[int, Callable[..., Any]] = {}
_PARENT: list[Connection] = []


def say(value: Any) -> None:
    """In a worker: have the parent receive a value before the function returns."""
    _PARENT[0].send((False, True, value))


def _answer(key: int, made_by: tuple[Callable[..., Any], tuple[Any, ...]] | None, question: tuple[Any, ...]) -> Any:
    if made_by is not None:
        make, arguments = made_by
        _KEPT[key] = make(*arguments)
    return _KEPT[key](*question)


def serve(link: Connection, modules: Sequence[str]) -> None:
    """Call what comes through the link, one after the other, until it is closed."""
    _PARENT.append(link)
    calls: queue.SimpleQueue[tuple[Callable[..., Any], tuple[Any, ...]]] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(link, calls), daemon=True).start()
    for module in modules:
        importlib.import_module(module)
    while True:
        function, arguments = calls.get()
        try:
            outcome = True, True, function(*arguments)
        except Exception as error:
            outcome = True, False, error
        link.send(outcome)


def _receive(link: Connection, calls: queue.SimpleQueue[Any]) -> None:
    """Put calls in the queue; end the process, also in the middle of a call, when the parent's end is closed."""
    while True:
        try:
            calls.put(link.recv())
        except (EOFError, OSError):
            os._exit(0)
        except Exception as error:  # a call that cannot be read here is one that fails
            calls.put((_fail, (error,)))


def _fail(error: Exception) -> None:
    raise error


def _main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this process
    link = Connection(int(sys.argv[1]))
    sys.path[:], modules = link.recv()
    importlib.import_module("crux_planner.solvers.worker").serve(link, modules)


if __name__ == "__main__":
    _main()
