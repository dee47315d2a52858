"""Loses a replica under a page in Chromium; `tests/pages/places.rs` starts two behind a balancer.

    replica.py URL TOKEN PROCESS

TOKEN is an operator's, PROCESS the number of the replica that the page is first led to.
"""

import os
import signal
import sys

from webdriver import Browser

ENTER = "\ue007"
HIDDEN = "return document.getElementById('connection').hidden"

pages, token, process = sys.argv[1:]
with Browser(1600, 1000) as browser:
    browser.open(pages)
    browser.type("#token", token)
    browser.press(ENTER)
    browser.wait("signed in", lambda: browser.text("h1") == "Farm")
    browser.run("window.isTheSame = true")
    browser.wait("connected", lambda: browser.run(HIDDEN))
    before = browser.text("#live-progress")
    browser.wait("progress", lambda: browser.text("#live-progress") != before)
    os.kill(int(process), signal.SIGKILL)
    browser.wait("disconnected", lambda: not browser.run(HIDDEN))
    assert "Disconnected" in browser.text()
    browser.wait("connected again", lambda: browser.run(HIDDEN))
    before = browser.text("#live-progress")
    browser.wait("going on", lambda: browser.text("#live-progress") != before)
    assert browser.run("return window.isTheSame === true"), "the page was loaded again"
    print("ok  a lost replica: the page says so, and goes on through another", flush=True)
    browser.click("#live-progress a[href*='do=pause']")
    browser.click("main form.confirm button")
    browser.wait("paused", lambda: "Done." in browser.text())
    print("ok  whoever signed in at the lost one still steers through the other", flush=True)
