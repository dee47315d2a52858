"""A client of WebDriver (W3C), as much of it as the pages need, over the standard library."""

import base64
import json
import subprocess
import time
import urllib.error
import urllib.request

ELEMENT = "element-6066-11e4-a52e-4f735466cecf"


class Browser:
    """Chromium, driven through chromedriver."""

    def __init__(self, width, height, dark=False):
        self.driver = subprocess.Popen(
            ["chromedriver", "--port=0"], stdout=subprocess.PIPE, text=True
        )
        for line in self.driver.stdout:
            if "started successfully on port" in line:
                self.port = int(line.rsplit(" ", 1)[1].strip(" .\n"))
                break
        arguments = ["--headless=new", "--no-sandbox", "--hide-scrollbars", "--disable-gpu"]
        options = {"args": arguments}
        wanted = {
            "browserName": "chrome",
            "goog:chromeOptions": options,
            # Certificates of tests are signed by nobody whom a browser knows.
            "acceptInsecureCerts": True,
        }
        session = self._call("POST", "/session", {"capabilities": {"alwaysMatch": wanted}})
        self.session = f"/session/{session['sessionId']}"
        # Windows have a least width; what is in them has none.
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._develop("Emulation.setDeviceMetricsOverride", size)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._develop("Emulation.setEmulatedMedia", {"features": [scheme]})

    def __enter__(self):
        return self

    def __exit__(self, *_):
        try:
            self._call("DELETE", self.session)
        finally:
            self.driver.kill()
            self.driver.wait()

    def _call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            f"http://127.0.0.1:{self.port}{path}", data, method=method
        )
        request.add_header("Content-Type", "application/json")
        try:
            with urllib.request.urlopen(request, timeout=120) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(json.load(error)["value"]["message"]) from None

    def _develop(self, command, parameters):
        """A command of the DevTools protocol."""
        body = {"cmd": command, "params": parameters}
        return self._call("POST", self.session + "/goog/cdp/execute", body)

    def open(self, url):
        self._call("POST", self.session + "/url", {"url": url})

    def address(self):
        return self._call("GET", self.session + "/url")

    def run(self, script, *arguments):
        body = {"script": script, "args": list(arguments)}
        return self._call("POST", self.session + "/execute/sync", body)

    def run_async(self, script):
        return self._call("POST", self.session + "/execute/async", {"script": script, "args": []})

    def find(self, css):
        found = self._call(
            "POST", self.session + "/element", {"using": "css selector", "value": css}
        )
        return found[ELEMENT]

    def click(self, css):
        while True:
            try:
                return self._call("POST", f"{self.session}/element/{self.find(css)}/click", {})
            except AssertionError as error:
                # Live sections are renewed between finding and clicking.
                if "stale element" not in str(error):
                    raise

    def type(self, css, text):
        self._call("POST", f"{self.session}/element/{self.find(css)}/value", {"text": text})

    def press(self, *keys):
        """Presses keys one after the other, wherever the focus is."""
        actions = []
        for key in keys:
            actions += [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        body = {"actions": [{"type": "key", "id": "keyboard", "actions": actions}]}
        self._call("POST", self.session + "/actions", body)

    def text(self, css="main"):
        return self._call("GET", f"{self.session}/element/{self.find(css)}/text")

    def wait(self, what, until, patience_s=60):
        """Waits until something holds; no page is loaded meanwhile by this."""
        deadline = time.monotonic() + patience_s
        while True:
            try:
                if found := until():
                    return found
            except AssertionError:
                # The page may be changing.
                pass
            assert time.monotonic() < deadline, f"not in time: {what}\n{self.text('body')[:3000]}"
            time.sleep(0.1)

    def screenshot(self, path):
        """The whole page, however long it is."""
        wanted = {"format": "png", "captureBeyondViewport": True}
        picture = self._develop("Page.captureScreenshot", wanted)
        with open(path, "wb") as file:
            file.write(base64.b64decode(picture["data"]))
