"""Decides who may open the page: only this computer, or every computer that has the token.

A browser lets every page that it shows connect to every address that it reaches, including this
computer's own. So each request must come from the page itself (`Origin`), and must name an address under
which the page is served (`Host`): another page cannot give orders through the operator's browser.
"""

from __future__ import annotations

import contextlib
import hmac
import io
import ipaddress
import secrets
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

if TYPE_CHECKING:
    import viser
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

SHORTEST = 16
"""Smallest number of characters of a token; the same as for the control socket."""
COOKIE = "tilthex-view"
LOOPBACK = ("127.0.0.1", "localhost", "::1")


@dataclass(frozen=True)
class Gate:
    """The address of the page, and who may open it."""

    host: str
    port: int
    token: str | None
    """Required if the address can be reached from other computers."""

    def admits(self, path: str, headers: Any) -> str | None:
        """Why a request is refused, as a sentence; None if it is accepted.

        Args:
            path: The path of the request, with its query.
            headers: The headers of the request: a mapping.
        """
        host = headers.get("Host", "")
        if self.token is None and _name(host) not in LOOPBACK:
            return f"this page is served only to this computer, not under the name {host!r}"
        origin = headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return f"a page of {origin!r} may not open this one"
        if self.token is not None and not self._shown(path, headers.get("Cookie", "")):
            return "the token is missing or wrong; open the address that `tilthex view` printed"
        return None

    def _shown(self, path: str, cookies: str) -> bool:
        assert self.token is not None
        shown = parse_qs(urlsplit(path).query).get("token", [])
        try:
            cookie = SimpleCookie(cookies).get(COOKIE)
        except CookieError:
            cookie = None
        if cookie is not None:
            shown.append(cookie.value)
        return any(hmac.compare_digest(each.encode(), self.token.encode()) for each in shown)

    def url(self, port: int) -> str:
        """The address that a person opens."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/" + ("" if self.token is None else f"?token={self.token}")


def gate(address: str, token_file: Path | None) -> Gate:
    """The gate of an address, HOST:PORT.

    An address that others can reach has a token, a new one or one from a file.

    Raises:
        ValueError: The address means every network, or the token is too short; the message says what is
        expected.
    """
    host, separator, port = address.rpartition(":")
    host = host.strip("[]")
    if not separator or not host or not port.isdecimal() or int(port) > 65535:
        raise ValueError(f"--listen is {address!r}; expected ADDRESS:PORT, such as 127.0.0.1:8080")
    try:
        found = socket.getaddrinfo(host, int(port), type=socket.SOCK_STREAM)
    except socket.gaierror as error:
        raise ValueError(
            f"--listen names {host!r}, which is not an address of this computer: {error}"
        ) from None
    # A name may have several addresses, and the page is served at all of them.
    numbered = [ipaddress.ip_address(entry[4][0]) for entry in found]
    every = ipaddress.ip_address("0.0.0.0")
    if any(each.is_unspecified or getattr(each, "ipv4_mapped", None) == every for each in numbered):
        raise ValueError(f"--listen {host} means every network; expected one address of this computer")
    token = None if token_file is None else _read(token_file)
    if token is None and not all(each.is_loopback for each in numbered):
        token = secrets.token_hex(16)
    return Gate(host, int(port), token)


def serve(guard: Gate) -> viser.ViserServer:
    """Starts the server behind a gate.

    Raises:
        OSError: The address cannot be used.
    """
    import viser

    # viser prints an address without the token.
    with _guarded(guard) as used, contextlib.redirect_stdout(io.StringIO()):
        try:
            server = viser.ViserServer(host=guard.host, port=guard.port, label="tilthex", verbose=False)
        except OSError as error:
            raise OSError(f"the page cannot be served at {guard.host}:{guard.port}: {error}") from error
    if not used:
        server.stop()
        raise ImportError(
            "this version of viser does not ask tilthex who may connect: pip install 'tilthex[view]'"
        )
    return server


@contextlib.contextmanager
def _guarded(guard: Gate) -> Iterator[list[bool]]:
    """While it is active, every new server of `websockets` asks the gate before it answers.

    viser has no hook for this. The yielded list is filled once a server is made.
    """
    import websockets.asyncio.server as module

    plain = module.serve
    used: list[bool] = []

    def serve(*arguments: Any, process_request: Any, **options: Any) -> Any:
        used.append(True)

        def answer(connection: ServerConnection, request: Request) -> Response | None:
            refusal = guard.admits(request.path, request.headers)
            if refusal is not None:
                return connection.respond(403, refusal + "\n")
            response: Response | None = process_request(connection, request)
            if response is not None and guard.token is not None:
                # From now on the requests of this page have the cookie; those of other pages do not.
                cookie = f"{COOKIE}={guard.token}; HttpOnly; SameSite=Strict; Path=/"
                response.headers["Set-Cookie"] = cookie
            return response

        return plain(*arguments, process_request=answer, **options)

    module.serve = serve  # type: ignore[assignment, misc]
    try:
        yield used
    finally:
        module.serve = plain  # type: ignore[misc]


def _name(host: str) -> str:
    """The name in a `Host` header, without the port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _read(path: Path) -> str:
    token = path.read_text(encoding="utf-8").strip()
    if len(token) < SHORTEST:
        raise ValueError(
            f"the token in {path} has {len(token)} characters; expected {SHORTEST} or more, such as "
            "`openssl rand -hex 16` gives"
        )
    if not token.isascii() or not token.isalnum():
        raise ValueError(
            f"the token in {path} has characters that are not letters or digits, which an address cannot hold"
        )
    return token
