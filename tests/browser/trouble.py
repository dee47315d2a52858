"""Mends a farm with trouble in Chromium; `tests/pages/trouble.rs` starts it. trouble.py URL"""

import sys

from webdriver import Browser

pages = sys.argv[1]
with Browser(1600, 1000) as browser:
    browser.open(pages)
    trouble = browser.text("#live-trouble")
    assert "Material 0: no rays came back: <b>lens cap</b>" in trouble, trouble
    assert "liar-0: " in trouble, trouble
    print("ok  a quarantined material and a blocked liar, each with its reason", flush=True)
    browser.click("#live-trouble a[href*='do=retry'][href*='material=0']")
    assert "its failures are forgotten" in browser.text()
    browser.click("main form.confirm button")
    browser.wait("changed", lambda: "1 material changed." in browser.text())
    browser.open(pages)
    browser.wait(
        "all materials", lambda: "12 of 12 materials" in browser.text("#live-progress")
    )
    browser.wait("no quarantine", lambda: "quarantined" not in browser.text("#live-trouble"))
    print("ok  the quarantined material is retried by its button, and rendered", flush=True)
