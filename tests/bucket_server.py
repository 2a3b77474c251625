"""An S3 server of moto as a process of its own, which counts its requests and can refuse some of them.

``python bucket_server.py PORT``. ``GET /-/requests`` answers the requests since the last such question, by kind;
``GET /-/faults?share=0.2&status=503`` refuses that share of them from then on, those of ``method=PUT`` only if stated.
"""

from __future__ import annotations

import json
import random
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from threading import Lock
from typing import Any
from urllib.parse import parse_qs

from moto.moto_server.werkzeug_app import DomainDispatcherApplication, MotoRequestHandler, create_backend_app
from werkzeug.serving import run_simple

Answer = Callable[[str, list[tuple[str, str]]], Any]

_CODES = {403: "AccessDenied", 500: "InternalError", 503: "SlowDown"}


class Counted:
    """A WSGI application with its requests counted, and a share of them refused."""

    def __init__(self, application: Callable[[dict[str, Any], Answer], Iterable[bytes]]) -> None:
        self.application = application
        self.requests: Counter[str] = Counter()
        self.share, self.status, self.method = 0.0, 503, ""
        self.random, self.lock = random.Random(1), Lock()

    def __call__(self, environ: dict[str, Any], answer: Answer) -> Iterable[bytes]:
        """Answer a request."""
        path, asked = environ["PATH_INFO"], parse_qs(environ["QUERY_STRING"], keep_blank_values=True)
        with self.lock:
            if path.startswith("/-/"):
                return self._own(path, asked, answer)
            method = environ["REQUEST_METHOD"]
            self.requests["LIST" if method == "GET" and "list-type" in asked else method] += 1
            refused = self.method in ("", method) and self.random.random() < self.share
        if not refused:
            return self.application(environ, answer)
        environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
        code = _CODES[self.status]
        answer(f"{self.status} {code}", [("Content-Type", "application/xml")])
        return [f"<Error><Code>{code}</Code><Message>{code}</Message></Error>".encode()]

    def _own(self, path: str, asked: Mapping[str, list[str]], answer: Answer) -> Iterable[bytes]:
        answer("200 OK", [("Content-Type", "application/json")])
        if path == "/-/requests":
            counts, self.requests = dict(self.requests), Counter()
            return [json.dumps(counts).encode()]
        self.random = random.Random(1)  # so that a test does not depend on the one before it
        self.share, self.status = float(asked["share"][0]), int(asked.get("status", ["503"])[0])
        self.method = asked.get("method", [""])[0]
        return [b"{}"]


if __name__ == "__main__":
    counted = Counted(DomainDispatcherApplication(create_backend_app))
    run_simple("127.0.0.1", int(sys.argv[1]), counted, threaded=True, request_handler=MotoRequestHandler)
