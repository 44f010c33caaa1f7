"""A headless Chromium, driven by its own protocol: it opens a page, runs scripts, takes pictures."""

import base64
import contextlib
import itertools
import json
import os
import re
import shutil
import subprocess
import time

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
PATIENCE = 60.0


def browser():
    """The path of a Chromium; skips the test where there is none, and where nobody waits for it."""
    if not os.environ.get("TILTHEX_BROWSER"):
        pytest.skip("TILTHEX_BROWSER is not set: `make browser-test` looks at the page in a browser")
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip(f"none of {', '.join(NAMES)} is installed: the page is not looked at in a browser")
    return found


class Tab:
    """A page of the browser."""

    def __init__(self, socket):
        self._socket, self._ids = socket, itertools.count(1)

    def command(self, method, **parameters):
        number = next(self._ids)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(PATIENCE))
            if answer.get("id") == number:
                assert "error" not in answer, answer
                return answer["result"]

    def run(self, script):
        """What a script gives."""
        answer = self.command("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def text(self):
        return self.run("document.body.innerText")

    def wait(self, script):
        """Waits until a script gives something that is true, and gives it."""
        end = time.monotonic() + PATIENCE
        while not (found := self.run(script)):
            assert time.monotonic() < end, f"{script} stays {found!r} in:\n{self.text()}"
            time.sleep(0.1)
        return found

    def click(self, label):
        """Clicks the button with a label."""
        find = (
            f"[...document.querySelectorAll('button')].find(b => b.innerText.trim() == {json.dumps(label)})"
        )
        self.wait(f"!!{find}")
        self.run(f"{find}.click()")

    def press(self, key, modifiers=0):
        """Presses a letter; modifiers as the protocol counts them, 8 for shift."""
        about = {"key": key, "code": f"Key{key.upper()}", "modifiers": modifiers}
        about["windowsVirtualKeyCode"] = ord(key.upper())
        self.command("Input.dispatchKeyEvent", type="keyDown", **about)
        self.command("Input.dispatchKeyEvent", type="keyUp", **about)

    @contextlib.contextmanager
    def dragged(self, x, y, right, down, steps=10):
        """Drags the mouse from a place, and holds it where it comes to."""

        def mouse(kind, part):
            place = {"x": x + part * right, "y": y + part * down}
            buttons = 0 if kind == "mouseReleased" else 1
            self.command("Input.dispatchMouseEvent", type=kind, button="left", buttons=buttons, **place)

        self.command("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        time.sleep(1.0)
        mouse("mousePressed", 0.0)
        for step in range(1, steps + 1):
            time.sleep(0.1)
            mouse("mouseMoved", step / steps)
        yield
        mouse("mouseReleased", 1.0)

    def drawn(self, path):
        """Takes a picture of a page of `tilthex view` when it is drawn, without messages."""
        self.wait("document.querySelectorAll('.uplot canvas').length >= 5")
        close = "document.querySelectorAll('.mantine-Notification-closeButton')"
        self.run(f"{close}.forEach(button => button.click())")
        time.sleep(3.0)
        self.picture(path)

    def picture(self, path):
        path.write_bytes(base64.b64decode(self.command("Page.captureScreenshot", format="png")["data"]))


@contextlib.contextmanager
def opened(url, folder, size=(1280, 800)):
    """A tab of a new browser with an address; `folder` takes the browser's profile."""
    from websockets.sync.client import connect

    arguments = [
        "--headless=new", "--no-sandbox", "--remote-debugging-port=0", f"--user-data-dir={folder}",
        "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-first-run",
        f"--window-size={size[0]},{size[1]}", "--disable-gpu-sandbox", "--disable-background-networking",
        "about:blank",
    ]  # fmt: skip
    process = subprocess.Popen(
        [browser(), *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    try:
        port = None
        for line in process.stderr:
            if match := re.search(r"listening on ws://127.0.0.1:(\d+)/", line):
                port = match[1]
                break
        assert port, "the browser did not start"
        import urllib.request

        request = urllib.request.Request(f"http://127.0.0.1:{port}/json/new?about:blank", method="PUT")
        with urllib.request.urlopen(request) as answer:
            target = json.load(answer)["webSocketDebuggerUrl"]
        with connect(target, max_size=None) as socket:
            tab = Tab(socket)
            tab.command(
                "Emulation.setDeviceMetricsOverride",
                width=size[0],
                height=size[1],
                deviceScaleFactor=1,
                mobile=False,
            )
            tab.command("Page.navigate", url=url)
            yield tab
    finally:
        process.kill()
        process.communicate()
