"""Rendering: digests, errors, threads, interruption."""

import multiprocessing
import os
import signal
import threading
import time

import numpy as np
import pytest

import brdfarm


def test_twenty_digests_are_the_commands(spec, command, tmp_path):
    (tmp_path / "spec.toml").write_text(spec.to_toml())
    for material in range(7):
        for view in range(3):
            if material == 6 and view == 2:
                continue
            arguments = ["--spec", "spec.toml", "--material", material, "--view", view]
            said = command("render", *arguments, "--out", "a.exr", "--error-out", "error.exr")
            image = brdfarm.render(spec, spec.material(material), view)
            assert image.error_exr == (tmp_path / "error.exr").read_bytes()
            assert image.digest == said.split()[0]
            assert image.exr == (tmp_path / "a.exr").read_bytes()


def test_a_rendering_has_pixels_and_their_errors(spec, tmp_path):
    image = brdfarm.render(spec, spec.material(1), 1)
    assert image.pixels.shape == spec.shape and image.pixels.dtype == np.float32
    assert image.error.shape == spec.shape[:2] and (image.error >= 0).all()
    assert image.error_max == pytest.approx(image.error.max(), rel=1e-6)
    assert 0 <= image.within_target <= 1 and image.seconds > 0
    assert image.integrator in ("hybrid", "path")
    image.save(tmp_path / "a.exr")
    assert (tmp_path / "a.exr").read_bytes() == image.exr
    exact = brdfarm.render(spec, spec.material(1), 1, relative=1e-4, absolute=1e-7)
    assert (np.abs(exact.pixels.max(-1) - image.pixels.max(-1)) <= image.error + exact.error + 1e-6).all()


def test_threads_and_backends_give_the_same_bytes(spec):
    images = [
        brdfarm.render(spec, spec.material(0), 1, threads=threads, backend=backend)
        for threads, backend in ((1, "auto"), (2, "native"), (3, "embree"))
    ]
    assert len({image.digest for image in images}) == 1


def test_what_cannot_be_rendered_is_refused(spec):
    for view in (-1, 3):
        with pytest.raises(ValueError, match="there is no view"):
            brdfarm.render(spec, spec.material(0), view)
    with pytest.raises(ValueError, match="quick"):
        brdfarm.render(spec, spec.material(0), 0, backend="quick")
    with pytest.raises(ValueError, match="threads"):
        brdfarm.render(spec, spec.material(0), 0, threads=-1)
    with pytest.raises(ValueError, match="relative"):
        brdfarm.render(spec, spec.material(0), 0, relative=-1.0)


def test_threads_of_python_run_meanwhile(spec):
    expected = [brdfarm.render(spec, spec.material(index), 0).digest for index in range(4)]
    found = [None] * 4

    def work(index):
        found[index] = brdfarm.render(spec, spec.material(index), 0).digest

    threads = [threading.Thread(target=work, args=(index,)) for index in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == expected


def _digest(spec, index):
    return brdfarm.render(spec, spec.material(index), 0).digest


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_process_that_forked_renders(spec, method):
    expected = [_digest(spec, index) for index in range(3)]
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.starmap(_digest, [(spec, index) for index in range(3)]) == expected


def test_ctrl_c_interrupts(spec):
    # Seconds of work: tight, of a large film.
    slow = spec.replace(
        image=dict(width=512, height=512),
        accuracy=dict(relative=1e-6, absolute=1e-8),
        integrator=dict(kind="path"),
    )
    killer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    killer.start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        brdfarm.render(slow, slow.material(0), 1)
    assert time.monotonic() - began < 5
