"""A second process that answers questions while this one answers others, where the machine has a second core.

It is forked, so that it knows what this one knows; what it says is what this one would say. Without a second core, or
where processes may not have children, there is none, and answers are the same, only later.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

Question = TypeVar("Question")
Answer = TypeVar("Answer")


class Second(Generic[Question, Answer]):
    """`answer` in another process, one question at a time."""

    def __init__(self, answer: Callable[[Question], Answer]) -> None:
        self._answer = answer
        self._link: Connection | None = None
        self._process: multiprocessing.process.BaseProcess | None = None

    def start(self) -> bool:
        """Whether there is a second process, from now on."""
        if self._process is not None:
            return True
        if len(os.sched_getaffinity(0)) < 2 or multiprocessing.current_process().daemon:
            return False
        context = multiprocessing.get_context("fork")
        self._link, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._answer), daemon=True)
        self._process.start()
        theirs.close()
        return True

    def ask(self, question: Question) -> None:
        """Begin with a question; its answer is to be had before the next one."""
        assert self._link is not None
        self._link.send(question)

    def hear(self) -> Answer:
        """The answer, when it is there."""
        assert self._link is not None
        answer: Answer = self._link.recv()
        return answer

    def later(self, question: Question) -> Callable[[], Answer]:
        """Begin with a question where there can be a second process; gives the answer when called, once."""
        if not self.start():
            return lambda: self._answer(question)
        self.ask(question)
        return self.hear

    def answers(self, questions: Sequence[Question]) -> list[Answer]:
        """The answers to all, every second one by the second process where there can be one."""
        told: list[Answer] = []
        for first, *other in (questions[i : i + 2] for i in range(0, len(questions), 2)):
            beside = bool(other) and self.start()
            if beside:
                self.ask(other[0])
            told.append(self._answer(first))
            told += [self.hear() if beside else self._answer(each) for each in other]
        return told

    def close(self) -> None:
        """End the process, whatever it is doing."""
        if self._process is not None and self._link is not None:
            self._process.terminate()
            self._process.join()
            self._link.close()
            self._process = self._link = None


def _serve(link: Connection, answer: Callable[[Any], Any]) -> None:
    try:
        while True:
            link.send(answer(link.recv()))
    except EOFError:
        pass
