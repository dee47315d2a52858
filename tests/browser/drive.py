"""Drives the pages of brdfarm in Chromium.

    drive.py BRDFARM AXE FOLDER

BRDFARM is the program, AXE the script of axe-core, FOLDER a folder for screenshots and logs.
"""

import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time

from webdriver import Browser

PROGRAM, AXE, FOLDER = sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])
TAB, ENTER, RIGHT = "\ue004", "\ue007", "\ue014"

SPECIFICATION = """
name = "driven"
materials = 150
[image]
width = 64
height = 64
"""


class Farm:
    """A coordinator that serves pages, and its workers."""

    def __init__(self, folder):
        self.folder = folder
        (folder / "spec.toml").write_text(SPECIFICATION)
        self.log = open(FOLDER / "farm.log", "w")
        self.workers = []
        self.listen, self.web = "127.0.0.1:0", "127.0.0.1:0"
        self.serve()

    def serve(self):
        said = self.folder / "said"
        said.write_text("")
        self.coordinator = self.start(
            ["coordinator", "serve", "--spec", "spec.toml", "--store", "store"]
            + ["--listen", self.listen, "--web", self.web],
            open(said, "w"),
        )
        deadline = time.monotonic() + 60
        while "pages at " not in (lines := said.read_text()):
            assert time.monotonic() < deadline, "the coordinator does not serve"
            time.sleep(0.05)
        self.url = next(l.split()[-1] for l in lines.splitlines() if l.startswith("listening"))
        self.pages = next(l.split()[-1] for l in lines.splitlines() if l.startswith("pages"))
        self.listen, self.web = (u.split("//")[1].strip("/") for u in (self.url, self.pages))

    def start(self, arguments, out):
        return subprocess.Popen(
            [PROGRAM, *arguments], cwd=self.folder, stdout=out, stderr=self.log
        )

    def work(self, name, *more):
        worker = self.start(
            ["worker", "connect", self.url, "--name", name, "--threads", "1"]
            + ["--backend", "native", *more],
            self.log,
        )
        self.workers.append(worker)
        return worker

    def end(self):
        for process in [*self.workers, self.coordinator]:
            process.kill()
            process.wait()


def step(what):
    print(f"ok  {what}", flush=True)


def without_reload(browser):
    """Marks the page, so that a page that was loaded again is found out."""
    browser.run("window.isTheSame = true")
    return lambda: browser.run("return window.isTheSame === true")


def watch(farm, browser):
    """A farm at work: what happens appears without a reload."""
    browser.open(farm.pages)
    is_same = without_reload(browser)
    browser.wait("nothing is done", lambda: "0 of 150 materials" in browser.text())
    victim = farm.work("victim")
    farm.work("honest")
    farm.work("another")
    browser.wait("workers", lambda: browser.text("#live-workers").count("there") >= 3)
    browser.wait("last images", lambda: browser.run(
        "return [...document.querySelectorAll('#live-last img')]"
        ".filter((image) => image.naturalWidth > 0).length") >= 4)
    victim.send_signal(signal.SIGKILL)
    assert is_same(), "the page was loaded again"
    step("progress, workers and last images appear without a reload; a worker is killed")


def confirm(browser, said):
    """Presses the button of the page that asks, and waits for what the next page says."""
    browser.click("main form.confirm button")
    browser.wait(said, lambda: said in browser.text())


def steer(farm, browser):
    """Operators act, each time after a page that says what will happen."""
    browser.click("#live-progress a[href*='do=pause']")
    assert "No job is handed out" in browser.text()
    confirm(browser, "Done.")
    browser.open(farm.pages + "jobs?state=pending")
    material = browser.run("return document.querySelector('td.number a').textContent")
    browser.click("td.actions a[href*='do=cancel']")
    confirm(browser, "1 material changed.")
    browser.open(farm.pages + "jobs?state=cancelled")
    assert browser.text("td.number") == material
    browser.click("td.actions a[href*='do=retry']")
    confirm(browser, "1 material changed.")
    step("paused, cancelled and retried by buttons")
    browser.open(farm.pages + "workers")
    browser.click("a[href*='do=block'][href*='another']")
    browser.type("#reason", "dust on its lens <b>")
    confirm(browser, "Blocked")
    browser.open(farm.pages)
    reason = "another: dust on its lens <b>"
    browser.wait(reason, lambda: reason in browser.text("#live-trouble"))
    browser.click("#live-trouble a[href*='do=unblock']")
    confirm(browser, "Unblocked.")
    step("a worker is blocked, with the reason as text, and unblocked")
    browser.open(farm.pages)
    browser.click("#live-progress a[href*='do=resume']")
    confirm(browser, "Done.")


def restart(farm, browser):
    """The page says that it is disconnected, then goes on."""
    browser.open(farm.pages)
    is_same = without_reload(browser)
    browser.wait("connected", lambda: browser.run(
        "return document.getElementById('connection').hidden"))
    farm.coordinator.kill()
    farm.coordinator.wait()
    browser.wait("disconnected", lambda: not browser.run(
        "return document.getElementById('connection').hidden"))
    assert "Disconnected" in browser.text()
    farm.serve()
    browser.wait("connected again", lambda: browser.run(
        "return document.getElementById('connection').hidden"))
    done = browser.text("#live-progress")
    browser.wait("going on", lambda: browser.text("#live-progress") != done)
    assert is_same(), "the page was loaded again"
    step("a coordinator that starts again: the page says so, and goes on")


def filters(farm, browser):
    """The address of a filter opens the same view again, once nothing changes any more."""
    browser.open(farm.pages)
    browser.wait("finished", lambda: "finished" in browser.text("#live-progress"), 300)
    browser.wait("all materials", lambda: browser.open(farm.pages + "materials")
                 or "150 complete materials." in browser.text())
    browser.open(farm.pages + "materials")
    browser.run("document.querySelector('details').open = true")
    browser.type("[name=roughness_max]", "40")
    browser.run("document.querySelector('[name=sort]').value = '-ior'")
    browser.click("form.filter button")
    browser.wait("filtered", lambda: "?" in browser.address())
    address, text = browser.address(), browser.text()
    assert "roughness_max=40" in address and "sort=-ior" in address, address
    assert "ior_min" not in address, address
    browser.open(farm.pages)
    browser.open(address)
    assert browser.text() == text
    step("the filter's address opens the same view again")


def material(farm, browser):
    """Exposure and values need no server, and the keyboard reaches them."""
    browser.open(farm.pages + "materials")
    browser.click(".card")
    browser.wait("values", lambda: browser.run("return document.querySelector('canvas') !== null"))
    browser.run("document.querySelector('canvas').focus()")
    browser.press(RIGHT, RIGHT)
    shown = browser.text("#values")
    assert "of white" in shown and "Column 34, row 32" in shown, shown
    at = "const c = document.querySelector('canvas'); " \
         "return [...c.getContext('2d').getImageData(0, 0, c.width, c.height).data]" \
         ".reduce((sum, value) => sum + value, 0)"
    before = browser.run(at)
    browser.run("const s = document.getElementById('stops'); s.value = 3; "
                "s.dispatchEvent(new Event('input'))")
    assert browser.run(at) > before
    browser.wait("stated errors", lambda: browser.run(
        "return document.getElementById('errors').naturalWidth") == 64)
    step("exposure, values under the point and the map of stated errors")


def keyboard(farm, browser):
    """From the first key on, every page is reached by the keyboard."""
    browser.open(farm.pages)
    browser.press(TAB)
    assert browser.run("return document.activeElement.className") == "skip"
    for name in ["Farm", "Materials", "Coverage", "Jobs", "Workers"]:
        browser.open(farm.pages)
        for _ in range(12):
            browser.press(TAB)
            if browser.run("return document.activeElement.textContent") == name:
                break
        browser.press(ENTER)
        browser.wait(name, lambda: browser.text("h1") == name)
    step("every page by the keyboard")


def pages(farm):
    yield from ["farm", "materials", "materials/1?view=5", "coverage", "jobs", "workers"]
    yield from ["act?do=prioritize&material=3", "materials?page=x", "nothing"]


def nothing_serious(browser, page):
    """No serious finding of axe-core on the page that is open."""
    browser.run(AXE.read_text() + "\n;window.axe = axe;")
    found = browser.run_async(
        "const done = arguments[arguments.length - 1];"
        "axe.run().then((found) => done(found.violations.map((v) =>"
        " [v.impact, v.id, v.nodes.slice(0, 3).map((n) => n.html)])))")
    serious = [one for one in found if one[0] in ("serious", "critical")]
    assert not serious, f"{page}: {serious}"


def axe(farm, browser):
    for page in pages(farm):
        browser.open(farm.pages + page)
        nothing_serious(browser, page)
    step(f"axe-core finds nothing serious on {len(list(pages(farm)))} pages")


def signing_in(farm):
    """With credentials a page asks for a token first, and goes on where somebody wanted to go."""
    subprocess.run([PROGRAM, "credentials", "keys"], cwd=farm.folder, check=True, stdout=farm.log)
    said = farm.folder / "browse"
    server = farm.start(
        ["dataset", "browse", "--listen", "127.0.0.1:0", "--credentials", "keys/coordinator"],
        open(said, "w"),
    )
    farm.workers.append(server)
    while "browse at " not in (line := said.read_text()):
        time.sleep(0.05)
    address = line.split()[-1]
    for width in (400, 1600):
        for dark in (False, True):
            with Browser(width, 700, dark) as browser:
                browser.open(address + "materials?sort=-ior")
                assert browser.text("h1") == "Sign in", browser.text()
                nothing_serious(browser, "login")
                browser.screenshot(FOLDER / f"login-{width}-{'dark' if dark else 'light'}.png")
                browser.press(*"wrong-token", ENTER)
                browser.wait("refused", lambda: "not known" in browser.text())
                browser.type("#token", (farm.folder / "keys/reader/token").read_text().strip())
                browser.press(ENTER)
                browser.wait("signed in", lambda: browser.address().endswith("sort=-ior"))
                assert "reader" in browser.text("header")
                browser.click(".account button")
                browser.wait("signed out", lambda: browser.text("h1") == "Sign in")
    step("signing in by keyboard leads on; a wrong token and signing out lead back")


def screenshots(farm):
    for width in (400, 1600):
        for dark in (False, True):
            with Browser(width, 1000, dark) as browser:
                for page in pages(farm):
                    browser.open(farm.pages + page)
                    time.sleep(1.5)
                    wide = browser.run("return document.documentElement.scrollWidth")
                    assert wide <= width, f"{page} is {wide} wide at {width}"
                    name = re.sub("[/?&=]", "-", page)
                    shade = "dark" if dark else "light"
                    browser.screenshot(FOLDER / f"{name}-{width}-{shade}.png")
    step("no page is wider than its window at 400 and 1600 px, light and dark")


def main():
    FOLDER.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        farm = Farm(pathlib.Path(folder))
        try:
            with Browser(1600, 1000) as browser:
                watch(farm, browser)
                steer(farm, browser)
                restart(farm, browser)
                filters(farm, browser)
                material(farm, browser)
                keyboard(farm, browser)
                axe(farm, browser)
            screenshots(farm)
            signing_in(farm)
        finally:
            farm.end()
    print("the pages hold in Chromium; screenshots are in", FOLDER)


main()
