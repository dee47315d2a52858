"""The main job from Python: progress, interruption, resuming, errors."""

import os
import signal
import subprocess
import sys
import textwrap
import time

import pytest

import brdfarm


def test_a_run_makes_a_dataset_and_says_how_far_it_is(spec, tmp_path):
    seen = []
    data = brdfarm.run(spec, tmp_path / "store", workers=2, progress=seen.append)
    assert len(data) == 12 and data.specification == spec
    assert seen[-1].images == seen[-1].total == 12 and seen[-1].errors == 0
    assert "12 of 12 images" in str(seen[-1])
    # Again: nothing to do; then more of it.
    assert len(brdfarm.run(None, tmp_path / "store")) == 12
    assert len(brdfarm.run(spec, tmp_path / "store", materials=5)) == 15


def test_progress_true_writes_a_line(spec, tmp_path, capsys):
    brdfarm.run(spec, tmp_path / "store", progress=True)
    assert "12 of 12 images" in capsys.readouterr().err


def test_a_display_that_fails_harms_nothing(spec, tmp_path, capsys):
    def broken(progress):
        raise RuntimeError("no display")

    assert len(brdfarm.run(spec, tmp_path / "store", progress=broken)) == 12
    assert "progress is shown no more" in capsys.readouterr().err


def test_errors_are_the_commands_sentences(spec, tmp_path):
    brdfarm.run(spec, tmp_path / "store")
    with pytest.raises(ValueError, match="holds another dataset"):
        brdfarm.run(spec.replace(seed=7), tmp_path / "store")
    with pytest.raises(ValueError, match="a set has"):
        brdfarm.run(spec, tmp_path / "other", materials=-4)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("")
    with pytest.raises(ValueError, match="is not a store"):
        brdfarm.run(spec, tmp_path / "full")


LONG = textwrap.dedent(
    """
    import sys, brdfarm
    spec = brdfarm.Specification.preset().replace(materials=4000, image=dict(width=16, height=16))
    try:
        brdfarm.run(spec, sys.argv[1], progress=lambda p: print(p.images, flush=True))
    except KeyboardInterrupt:
        print("interrupted", flush=True)
    """
)


def begun(store):
    """A process of Python in the middle of a long run, and how many images it said."""
    process = subprocess.Popen([sys.executable, "-c", LONG, store], stdout=subprocess.PIPE, text=True)
    for line in process.stdout:
        if int(line) > 0:
            return process
    raise AssertionError("the run ended")


def completed(store):
    return len(brdfarm.Dataset(store).materials)


def test_ctrl_c_stops_a_run_and_loses_nothing(tmp_path):
    store = tmp_path / "store"
    process = begun(str(store))
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=60)
    assert said.splitlines()[-1] == "interrupted" and process.returncode == 0
    there = completed(store)
    assert 0 < there < 4000
    data = brdfarm.run(None, store, materials=there + 1)
    assert completed(store) > there and data[0, 0].digest


def test_a_python_that_dies_leaves_no_run_behind(tmp_path):
    store = tmp_path / "store"
    process = begun(str(store))
    process.kill()
    process.wait()
    # The lock is free when the run has noticed.
    deadline = time.monotonic() + 60
    while True:
        try:
            brdfarm.run(None, store, materials=1)
            break
        except brdfarm.StoreError as error:
            assert "in use" in str(error) and time.monotonic() < deadline
            time.sleep(0.2)
    assert completed(store) > 0


def test_a_command_that_is_missing_says_so(spec, tmp_path, monkeypatch):
    monkeypatch.setenv("BRDFARM_COMMAND", os.fspath(tmp_path / "absent"))
    with pytest.raises(FileNotFoundError):
        brdfarm.run(spec, tmp_path / "store")
