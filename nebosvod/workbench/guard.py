"""Who may speak to the page's server: a browser on this machine that knows the token, for a page of this server."""

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]
# nothing but files of this server, and the looks of elements of figures; no frame around it, no request elsewhere
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; style-src-attr 'unsafe-inline'; "
    "connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = (
    ("cache-control", "no-store"),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    ("referrer-policy", "no-referrer"),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
)


class Guard:
    """Refuses a request before anything of it is read, and puts the headers on what is answered.

    Parameters
    ----------
    app : what answers.
    token : the first part of every path.
    port : where the server listens; a name other than this machine's own in `Host` is somebody's trick (DNS rebinding).
    """

    def __init__(self, app: App, token: str, port: int) -> None:
        self._app, self._token = app, token
        self._hosts = {f"{name}:{port}".encode() for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
        elif scope["type"] == "http":
            why = self._refused(scope)
            if why is not None:
                await _refuse(send, *why)
            else:
                await self._app(self._inside(scope), receive, _with_headers(send))
        else:  # no web sockets
            await send({"type": "websocket.close", "code": 1008})

    def _refused(self, scope: Scope) -> tuple[int, str] | None:
        """Status and words of a refusal; None for who may come in."""
        headers = scope["headers"]
        said = {name: [value for key, value in headers if key == name] for name in (b"host", b"origin")}
        hosts, origins = said[b"host"], said[b"origin"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return 421, "this server answers to 127.0.0.1 and localhost only"
        if origins and origins != [b"http://" + hosts[0]]:
            return 403, "another page may not speak to this server"
        if scope["method"] not in ("GET", "HEAD") and not origins:
            return 403, "a change must come from the page itself"
        sites = [value for key, value in headers if key == b"sec-fetch-site"]
        if any(site not in (b"same-origin", b"none") for site in sites) and not self._opens(scope):
            return 403, "another page may not speak to this server"
        first = scope["path"].split("/")[1] if scope["path"].startswith("/") else ""
        if not secrets.compare_digest(first.encode("utf-8", "replace"), self._token.encode()):
            return 404, "nothing is here; open the address that the terminal shows, whole"
        return None

    def _opens(self, scope: Scope) -> bool:
        """Whether a browser goes to the page itself, in a tab of its own: from the file that names it, or a link."""
        said = {key: value for key, value in scope["headers"] if key.startswith(b"sec-fetch-")}
        alone = said.get(b"sec-fetch-mode") == b"navigate" and said.get(b"sec-fetch-dest") == b"document"
        return alone and scope["method"] == "GET" and scope["path"] == f"/{self._token}/"

    def _inside(self, scope: Scope) -> Scope:
        """The same request without the token in its path."""
        path = scope["path"][1 + len(self._token) :]
        return {**scope, "path": path, "raw_path": path.encode()}


async def _refuse(send: Send, status: int, words: str) -> None:
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *((k.encode(), v.encode()) for k, v in HEADERS)]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": f"{words}\n".encode()})


def _with_headers(send: Send) -> Send:
    """A `send` that adds the headers, and the policy where the answer has none of its own."""

    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            headers = list(message.get("headers", ()))
            headers += [(name.encode(), value.encode()) for name, value in HEADERS]
            if not any(name == b"content-security-policy" for name, _ in headers):
                headers.append((b"content-security-policy", POLICY.encode()))
            message = {**message, "headers": headers}
        await send(message)

    return sending
