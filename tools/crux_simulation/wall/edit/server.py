"""The editor's server: a page for one file, which is the only one that it writes."""

from __future__ import annotations

import re
import secrets
import threading
from pathlib import Path
from typing import Any

from crux_contracts.output_file import OutputError
from crux_contracts.scenario import ScenarioError
from crux_contracts.yaml_document import Problem
from crux_tools.view.page_server import PageServer, Query, RefusedError, files_of
from crux_tools.view.server import PAGE as VIEWER

from crux_simulation.wall.edit.content import Content, missing
from crux_simulation.wall.edit.ghost import Ghost
from crux_simulation.wall.edit.wall_file import WallFile
from crux_simulation.wall.edit.work import Work

PAGE = Path(__file__).parent / "page"
WAIT_S = 20.0  # for news, before the page asks anew
_NUMBERED = re.compile(r"(holds|obstacles)\[(\d+)\]")


class Editor(PageServer):
    """A running editor of one file."""

    def __init__(self, file: WallFile, host: str, port: int) -> None:
        """Raises OSError where nothing can be listened on."""
        files = {**files_of(VIEWER), **{f"/edit{path}": each for path, each in files_of(PAGE).items()}}
        super().__init__(files, "/edit/edit.html", host, port)
        self._file, self._working = file, threading.Lock()  # one request a thread
        self._session = secrets.token_urlsafe(8)  # what a page of an editor before this one knows is of another file
        self._ghost = Ghost(file.robot, file.scenario)
        self._work = Work()
        self.start()

    def close(self) -> None:
        """Closes the port and ends what is being computed."""
        self._work.close()
        super().close()

    def answer(self, path: str, query: Query) -> Any:
        if path == "/wall":
            return self._wall()
        if path == "/found":
            return self._work.told(int(query["since"]), WAIT_S)
        if path == "/motion":
            return self._work.motion(int(query["version"]))
        return super().answer(path, query)

    def take(self, path: str, content: Any) -> Any:
        try:
            if content["session"] != self._session:
                raise RefusedError("The editor was started anew: reload this page; what it has not saved is lost then.")
            if path == "/edit":
                return self._edit(int(content["version"]), content["sketch"])
            if path == "/pose":
                return self._pose(content)
            if path == "/save":
                return self._save(content["sketch"], bool(content["over"]))
        except (AttributeError, IndexError, KeyError, TypeError) as error:
            raise ValueError(f"not understood: {error}") from error
        return super().take(path, content)

    def _wall(self) -> dict[str, Any]:
        is_new = self._file.data is None
        return {
            "name": self._file.path.name,
            "isNew": is_new,
            "sketch": self._file.sketch(),
            "shapes": self._ghost.shapes,
            "session": self._session,
        }

    def _edit(self, version: int, sketch: Content) -> dict[str, Any]:
        """What is wrong with a sketch, with the hold that it is about; where nothing is, the work on it begins."""
        with self._working:
            try:
                content, scenario = self._file.with_sketch(sketch)
            except ScenarioError as error:
                self._work.leave(version)
                content = self._file.content_of(sketch)
                return {"problems": [_told(each, content) for each in error.problems], "missing": missing(content)}
            self._work.look(version, content, scenario)
            return {"problems": [], "missing": missing(content)}

    def _pose(self, asked: Content) -> dict[str, Any]:
        with self._working:
            return {"poses": self._ghost.stand(asked["sketch"]["bodies"], asked["body"], asked["grasps"])}

    def _save(self, sketch: Content, over: bool) -> dict[str, Any]:
        with self._working:
            try:
                return {"question": self._file.save(sketch, over)}
            except OutputError as error:
                return {"error": str(error)}


def _told(problem: Problem, content: Content) -> dict[str, Any]:
    """In words without the file's name, and the name of the hold."""
    text = ": ".join(part for part in (problem.key, problem.value, problem.expected) if part)
    found = _NUMBERED.match(problem.key)
    if found is None:
        return {"text": text, "hold": None}
    hold = str(content[found[1]][int(found[2])].get("name"))
    return {"text": text.replace(found[0], hold, 1), "hold": hold}
