"""Notes on runs in the panel: comments, photos and files that a user adds afterwards, shown and written."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

from anyio import CapacityLimiter, to_thread
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from astb.panel.access import NotAllowed
from astb.panel.answers import answered
from astb.panel.commands import json_answer, read_body, refusal
from bench_records.layout import RecordError
from bench_records.notes import FILE_MAX, NOTES, add_note, is_as_added, notes_of

if TYPE_CHECKING:
    from astb.panel.answers import Parts

#: Types that a browser may show as a picture; all other files are only downloaded, so no browser runs them.
PICTURES: Final = {
    ".png": "image/png",
    ".jpg": "image/jpeg",
    ".jpeg": "image/jpeg",
    ".gif": "image/gif",
    ".webp": "image/webp",
}
_TEXT_MAX: Final = 4000
_NAME: Final = re.compile(r"\w[\w .,()+-]{0,98}")
#: Number of files that are received at the same time: each is in memory until it is stored.
_AT_ONCE: Final = 2

#: Returns the directory of a run in the list. Raises RecordError if there is none.
Known = Callable[[str], Path]


def routes(parts: Parts, known: Known) -> Sequence[Route]:
    """Return the routes of notes."""
    return [
        Route("/api/kept/notes", answered(lambda request: listed(known(request.query_params["run"])))),
        Route("/api/kept/note", _adding(parts, known), methods=["POST"]),
        Route("/kept/note", _file(known)),
    ]


def listed(directory: Path) -> list[dict[str, Any]]:
    """Return the notes on a run, oldest first, each with whether its file is unchanged and whether it is a picture."""
    return [
        {
            "at": one.at,
            "by": one.by,
            "text": one.text,
            "file": one.file,
            "intact": is_as_added(directory, one),
            "picture": Path(one.file).suffix.lower() in PICTURES,
        }
        for one in notes_of(directory)
    ]


def _adding(parts: Parts, known: Known) -> Callable[[Request], Awaitable[Response]]:
    """Return the endpoint that stores a note: the text is in the address, the file is the body.

    The client needs the token.
    """
    places = CapacityLimiter(_AT_ONCE)

    async def endpoint(request: Request) -> Response:
        fields = {key: request.query_params.get(key, "") for key in ("run", "by", "text", "file")}
        try:
            await parts.access.slow_down(request)
            parts.access.require_token(request)
            _refuse(fields)
            directory = await to_thread.run_sync(known, fields["run"])
            async with places:
                most = FILE_MAX if fields["file"] else 0
                too_much = (
                    f"the file is too large; use at most {most // 1_000_000} MB"
                    if most
                    else "the file has no name; give it one"
                )
                content = await read_body(request, most, too_much)
                file = Path(fields["file"]) if fields["file"] else None
                await to_thread.run_sync(add_note, directory, fields["text"], fields["by"], file, content)
        except NotAllowed as error:
            return refusal(error, error.status)
        except RecordError as error:
            return refusal(error, 409)
        return json_answer({"done": None})

    return endpoint


def _refuse(fields: dict[str, str]) -> None:
    """Raise NotAllowed for a missing author, for texts that are too long or not UTF-8, and for an invalid file name."""
    for key, text in fields.items():
        try:
            text.encode()
        except UnicodeEncodeError:
            raise NotAllowed(f"{key} is not a valid UTF-8 text; enter it again", 400) from None
    if not fields["by"].strip():
        raise NotAllowed("the author of the note is missing; fill in the field for the author", 400)
    if len(fields["text"]) > _TEXT_MAX:
        raise NotAllowed(
            f"a note of {len(fields['text'])} characters is too long; use at most {_TEXT_MAX}", 413
        )
    if fields["file"] and not _NAME.fullmatch(fields["file"]):
        raise NotAllowed(
            f"{fields['file']!r} is not a valid file name; use letters, digits, spaces and . , ( ) + - _", 400
        )


def _file(known: Known) -> Callable[[Request], Awaitable[Response]]:
    """Return the endpoint for the file of a note: pictures are displayed, other files downloaded."""

    async def endpoint(request: Request) -> Response:
        run, name = (request.query_params.get(key, "") for key in ("run", "file"))
        try:
            directory = await to_thread.run_sync(known, run)
            if name not in [one.file for one in notes_of(directory) if one.file]:
                raise RecordError(f"{run} has no note with a file {name}; reload the page")
            content = await to_thread.run_sync((directory / NOTES / Path(name).name).read_bytes)
        except RecordError as error:
            return PlainTextResponse(f"{error}\n", 404)
        except (OSError, ValueError):
            return PlainTextResponse(f"the file {name} of a note of {run} cannot be read; restore it\n", 404)
        kind = PICTURES.get(Path(name).suffix.lower(), "application/octet-stream")
        heads = {
            "X-Content-Type-Options": "nosniff",
            "Content-Security-Policy": "default-src 'none'; sandbox",
        }
        if kind not in PICTURES.values():
            heads["Content-Disposition"] = f"attachment; filename*=UTF-8''{quote(name)}"
        return Response(content, media_type=kind, headers=heads)

    return endpoint
