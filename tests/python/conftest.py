"""What the tests share: a small specification, and a store of it."""

import os
import signal

import pytest

import brdfarm

# Who starts the tests in the background has Ctrl-C ignored, and so have all that they start. Some of
# these tests are about it.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def spec():
    """24 x 20 pixels, three views, four materials."""
    preset = brdfarm.Specification.preset()
    views = [preset.views[number] for number in (0, 5, 8)]
    return preset.replace(image=dict(width=24, height=20), views=views, materials=4)


@pytest.fixture(scope="session")
def store(spec, tmp_path_factory):
    """A store that `run` made."""
    path = tmp_path_factory.mktemp("python") / "store"
    brdfarm.run(spec, path, workers=2)
    return path


@pytest.fixture
def command(tmp_path):
    """Runs the command; returns what it printed."""
    import subprocess

    from brdfarm import _command

    def run(*arguments):
        done = subprocess.run(
            [str(_command.path()), *map(str, arguments)],
            capture_output=True,
            text=True,
            check=True,
            cwd=tmp_path,
            env=dict(os.environ),
        )
        return done.stdout

    return run
