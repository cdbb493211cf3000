"""The pages that are open, and what each of them has running: long calls wait for their turn."""

from __future__ import annotations

import asyncio
import json
import secrets
import shutil
import sys
import tempfile
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from rotorfit.app.engine import Engine, JsonObject

MOST_PAGES: Final = 8
MOST_WAITING: Final = 16
"""Long calls of one page, those at work included."""
AT_ONCE: Final = 2
"""Processes of all pages."""
GRACE = 120.0
"""Time for which a page that was closed is kept: it may only be loaded anew [s]."""
LONGEST_RESPONSE: Final = 2**28
LOOKS: Final = ("add_file", "look")
STOPPED: Final[JsonObject] = {"refused": "stopped", "stopped": True}
Work = Callable[[Engine, "Job"], Awaitable[JsonObject]]
"""Runs a long call of an engine."""


@dataclass(slots=True, kw_only=True)
class Job:
    """A long call: its progress so far, and its response once there is one."""

    name: str
    argument: Mapping[str, Any]
    progress: Mapping[str, Any] | None = None
    response: JsonObject | None = None
    changed: asyncio.Event = field(default_factory=asyncio.Event)
    task: asyncio.Task[None] | None = None

    def report(self, progress: Mapping[str, Any]) -> None:
        """Set the progress, and wake those who wait for it."""
        self.progress = progress
        self._wake_listeners()

    def end(self, response: JsonObject) -> None:
        """Set the response, and wake those who wait for it."""
        self.response = response
        self._wake_listeners()

    def _wake_listeners(self) -> None:
        self.changed.set()
        self.changed = asyncio.Event()

    async def events(self) -> AsyncGenerator[dict[str, Any]]:
        """Yield progress, and at the end the response."""
        sent: Mapping[str, Any] | None = None
        while self.response is None:
            changed = self.changed
            if self.progress is not sent:
                sent = self.progress
                yield {"progress": sent}
            else:
                await changed.wait()
        yield {"answer": self.response}


@dataclass(slots=True, kw_only=True)
class Page:
    """A page: its folder, its long calls, and how often it is open."""

    key: str
    engine: Engine
    jobs: list[Job] = field(default_factory=list[Job])
    looking: asyncio.Lock = field(default_factory=asyncio.Lock)
    working: asyncio.Lock = field(default_factory=asyncio.Lock)
    present: int = 0
    held: int = 0
    """Bytes of its files, of those that are still being sent too."""
    leaving: asyncio.TimerHandle | None = None

    def running(self, name: str) -> Job | None:
        """Find a long call that has not ended."""
        return next((job for job in self.jobs if job.name == name), None)

    def stop(self, file: str | None = None) -> None:
        """End the work that is done or waits; for a file, the looks at it."""
        for job in self.jobs:
            looks = job.name in LOOKS
            wanted = looks and job.argument.get("name") == file if file else not looks
            if wanted and job.task is not None:
                job.task.cancel()


class Pages:
    """Every page of a server, in one private folder."""

    def __init__(self, *, most_bytes: int, work: Work | None = None) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="rotorfit-app-"))  # for nobody else: 0700
        self.most_bytes = most_bytes
        self.grace = GRACE
        self._call = work or call_in_process
        self.closing = asyncio.Event()
        self._pages: dict[str, Page] = {}
        self._slots = asyncio.Semaphore(AT_ONCE)

    def open(self, key: object) -> Page | None:
        """Return the page of a key, or a new one; None if too many are open in browsers."""
        page = self._pages.get(key) if isinstance(key, str) else None
        if page is not None:
            return page
        if len(self._pages) >= MOST_PAGES:
            abandoned = next((one for one in self._pages.values() if not one.present), None)
            if abandoned is None:
                return None
            self._forget_page(abandoned)
        folder = self.folder / secrets.token_hex(8)
        folder.mkdir(mode=0o700)
        key = secrets.token_urlsafe(16)
        page = Page(key=key, engine=Engine(folder=folder, most_bytes=self.most_bytes))
        self._pages[key] = page
        self._schedule_leaving(page)
        return page

    def get(self, key: str) -> Page | None:
        """Return a page that is open."""
        return self._pages.get(key)

    @contextmanager
    def present(self, page: Page) -> Generator[None]:
        """Keep a page for as long as it is open in a browser, and a little longer."""
        page.present += 1
        if page.leaving is not None:
            page.leaving.cancel()
        try:
            yield
        finally:
            page.present -= 1
            if not page.present and not self.closing.is_set():
                self._schedule_leaving(page)

    def _schedule_leaving(self, page: Page) -> None:
        loop = asyncio.get_running_loop()
        page.leaving = loop.call_later(self.grace, self._forget_if_left, page)

    def _forget_if_left(self, page: Page) -> None:
        if not page.present:
            self._forget_page(page)

    def _forget_page(self, page: Page) -> None:
        self._pages.pop(page.key, None)
        if page.leaving is not None:
            page.leaving.cancel()
        for job in page.jobs:
            if job.task is not None:
                job.task.cancel()
        page.engine.clear()

    def begin(self, page: Page, name: str, argument: Mapping[str, Any]) -> Job:
        """Start a long call, or let it wait for its turn."""
        job = Job(name=name, argument=argument)
        if len(page.jobs) >= MOST_WAITING:
            job.end({"refused": f"{len(page.jobs)} calls of this page wait already: try later"})
            return job
        page.jobs.append(job)
        job.task = asyncio.create_task(self._run_job(page, job))
        return job

    async def _run_job(self, page: Page, job: Job) -> None:
        turn = page.looking if job.name in LOOKS else page.working
        if turn.locked():
            job.report({"step": "waiting for its turn", "share": None})
        response: JsonObject = STOPPED
        try:
            async with turn, self._slots:
                response = await self._call(page.engine, job)
        except asyncio.CancelledError:
            pass  # stopped: the response says so
        finally:
            page.jobs.remove(job)
            job.end(response)

    async def end(self) -> None:
        """End all that runs, and remove everything."""
        self.closing.set()
        tasks = [job.task for page in self._pages.values() for job in page.jobs if job.task]
        for page in list(self._pages.values()):
            self._forget_page(page)
        await asyncio.gather(*tasks, return_exceptions=True)
        self.clear()

    def clear(self) -> None:
        """Remove everything from the disk."""
        shutil.rmtree(self.folder, ignore_errors=True)


async def call_in_process(engine: Engine, job: Job) -> JsonObject:
    """Run a long call in a process of its own, which ends with it or is ended."""
    command = (sys.executable, "-P", "-m", "rotorfit.app.job", str(engine.folder))
    pipe, nothing = asyncio.subprocess.PIPE, asyncio.subprocess.DEVNULL
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=pipe,
        stdout=pipe,
        stderr=nothing,
        limit=LONGEST_RESPONSE,
        start_new_session=True,  # Ctrl-C is for the server, which ends it
    )
    try:
        assert process.stdin is not None and process.stdout is not None
        request = {"name": job.name, "argument": job.argument, "most_bytes": engine.most_bytes}
        process.stdin.write(f"{json.dumps(request)}\n".encode())
        async for line in process.stdout:
            message = json.loads(line)
            if "answer" in message:
                return message["answer"]
            job.report(message["progress"])
        status = await process.wait()
        return {
            "refused": f"the work ended before it was done (exit status {status}; out of memory?): "
            "the page is as before, try again with shorter logs"
        }
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await asyncio.shield(process.wait())
