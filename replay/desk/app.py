"""The pages of the desk and what their buttons do."""

from __future__ import annotations

import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.templating import Jinja2Templates

from models.common.errors import LogError
from models.common.pages.document import PAGE_STYLE
from replay.desk.guard import Guard
from replay.desk.question import Question, others, rows
from replay.desk.store import MOST_BYTES, Ask, Desk, Drop, one_of, read_text
from replay.desk.trial import make
from replay.desk.work import Work
from replay.logs.formats import known_suffixes

_HERE = Path(__file__).parent
_LONGEST_FORM = 1 << 18
_SEE_OTHER = 303
_NO_ROOM = 507
_IN_WORDS = {"Not Found": "there is no such page", "Method Not Allowed": "this page takes a form"}
"""What the library says of a wrong address."""


class _Pages:
    """One function a page or button."""

    def __init__(self, desk: Desk, work: Work, most: int) -> None:
        self._desk = desk
        self._work = work
        self._most = most
        self._templates = Jinja2Templates(_HERE / "templates")
        known = {
            "style": PAGE_STYLE,
            "folder": desk.folder,
            "most": most,
            "suffixes": list(known_suffixes()),
            "step": work.step,
        }
        self._templates.env.globals.update(known)

    def home(self, request: Request) -> Response:
        """All drops."""
        return self._templates.TemplateResponse(request, "home.html", {"drops": self._desk.drops})

    def new_drop(self, _: Request) -> Response:
        """A place for the logs that come next."""
        return JSONResponse({"page": f"/drops/{self._desk.new_drop().folder.name}"}, 201)

    def show(self, request: Request) -> Response:
        """The logs of a drop, the form, and the answers."""
        drop = self._drop(request)
        asks = drop.asks
        texts = {log.name: read_text(drop.info(log)) for log in drop.logs}
        drafts = (part.get("vehicle") for ask in asks for part in (ask.answer, *ask.season))
        draft: dict[str, Any] = next(filter(None, drafts), {})
        facts = [*draft.get("known", ()), *draft.get("assumed", ())]
        if asks:
            last = asks[0].question
        else:
            last = {}
        answered = next((a for a in asks if a.answered), None)
        shown = {
            "drop": drop,
            "asks": asks,
            "texts": texts,
            "version": self._version(drop),
            "rows": rows(facts),
            "others": others(facts),
            "good": last.get("good", ()),
            "typed": dict(last.get("numbers", ())),
            "text": next(filter(None, (a.vehicle_text for a in asks)), ""),
            "answered": answered,
        }
        return self._templates.TemplateResponse(request, "drop.html", shown)

    async def upload(self, request: Request) -> Response:
        """One log."""
        changed_s = request.query_params.get("changed_s", "")
        name = request.path_params["name"]
        chunks = request.stream()
        log = await self._drop(request).receive(name, chunks, self._most, changed_s)
        return JSONResponse({"log": log.name}, 201)

    def remove_log(self, request: Request) -> Response:
        """Delete one log."""
        drop = self._drop(request)
        drop.remove(one_of(drop.logs, request.path_params["name"]))
        return _back(drop)

    async def ask(self, request: Request) -> Response:
        """Put a question into the queue."""
        body = b""
        async for chunk in request.stream():
            body += chunk
            if len(body) > _LONGEST_FORM:
                raise HTTPException(413, "the form is too long")
        drop = self._drop(request)
        question = Question.of(parse_qsl(body.decode("utf-8", "replace")), drop)
        self._work.start(drop, question.written(drop), question)
        return _back(drop)

    async def trial(self, _: Request) -> Response:
        """A simulated flight, and the first question about it."""
        drop = self._desk.new_drop()
        try:
            await make(drop.folder / "logs")
        except LogError as error:
            await run_in_threadpool(shutil.rmtree, drop.folder, ignore_errors=True)
            raise HTTPException(500, f"no flight was simulated: {error}") from None
        question = Question.of([("kind", "missing")], drop)
        self._work.start(drop, question.written(drop), question)
        return _back(drop)

    async def again(self, request: Request) -> Response:
        """Ask a question once more: what was answered of its logs is taken over."""
        drop = self._drop(request)
        question = Question.again(self._ask(request, drop), drop)
        self._work.start(drop, question.written(drop), question)
        return _back(drop)

    async def cancel(self, request: Request) -> Response:
        """End one question."""
        drop = self._drop(request)
        await self._work.cancel(self._ask(request, drop))
        return _back(drop)

    async def remove(self, request: Request) -> Response:
        """Delete a drop with everything in it."""
        drop = self._drop(request)
        await self._work.cancel(*drop.asks)
        await run_in_threadpool(shutil.rmtree, drop.folder, ignore_errors=True)
        return RedirectResponse("/", _SEE_OTHER)

    async def refused(self, request: Request, error: Exception) -> Response:
        """A page with a way back for a browser, a line for what copies a log."""
        if isinstance(error, HTTPException):
            line = _IN_WORDS.get(error.detail, error.detail)
            code = error.status_code
        else:
            line = f"nothing more can be kept here: {getattr(error, 'strerror', error)}"
            code = _NO_ROOM
        if "text/html" not in request.headers.get("accept", ""):
            return PlainTextResponse(line, code)
        shown = {"line": line, "back": self._way_back(request)}
        return self._templates.TemplateResponse(request, "error.html", shown, code)

    def _way_back(self, request: Request) -> str:
        """The page that the request came from: of its logs, where they are still there."""
        name = request.path_params.get("drop")
        if name in {drop.folder.name for drop in self._desk.drops}:
            return f"/drops/{name}"
        return "/"

    def _drop(self, request: Request) -> Drop:
        return Drop(one_of((drop.folder for drop in self._desk.drops), request.path_params["drop"]))

    def _ask(self, request: Request, drop: Drop) -> Ask:
        return Ask(one_of((ask.folder for ask in drop.asks), request.path_params["number"]))

    def _version(self, drop: Drop) -> str:
        looked = sum(drop.info(log).exists() for log in drop.logs)
        return (
            f"{len(drop.logs)} {looked} {len(drop.asks)} "
            f"{sum(not self._work.step(ask) for ask in drop.asks)}"
        )


def app(desk: Desk, work: Work | None = None, most: int = MOST_BYTES) -> Starlette:
    """The whole server. ``most``: bytes of one log."""
    work = work or Work()
    pages = _Pages(desk, work, most)

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        yield
        await work.close()

    routes = [
        Route("/", pages.home),
        Route("/drops", pages.new_drop, methods=["POST"]),
        Route("/trial", pages.trial, methods=["POST"]),
        Route("/drops/{drop}", pages.show),
        Route("/drops/{drop}/delete", pages.remove, methods=["POST"]),
        Route("/drops/{drop}/logs/{name:path}/delete", pages.remove_log, methods=["POST"]),
        Route("/drops/{drop}/logs/{name:path}", pages.upload, methods=["PUT"]),
        Route("/drops/{drop}/asks", pages.ask, methods=["POST"]),
        Route("/drops/{drop}/asks/{number}/cancel", pages.cancel, methods=["POST"]),
        Route("/drops/{drop}/asks/{number}/again", pages.again, methods=["POST"]),
        Mount("/files", StaticFiles(directory=desk.folder)),
        Mount("/static", StaticFiles(directory=_HERE / "static")),
    ]
    handlers = {OSError: pages.refused, HTTPException: pages.refused}
    return Starlette(
        routes=routes,
        middleware=[Middleware(Guard)],
        exception_handlers=handlers,
        lifespan=lifespan,
    )


def _back(drop: Drop) -> Response:
    return RedirectResponse(f"/drops/{drop.folder.name}", _SEE_OTHER)
