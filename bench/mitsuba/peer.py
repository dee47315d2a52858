"""Renders a scene with Mitsuba and measures its CPU seconds."""

import gc
import time

import drjit as dr
import mitsuba as mi
import numpy as np


class Peer:
    """One scene, rendered again and again."""

    def __init__(self, scene: mi.Scene):
        self.scene = scene

    def render(self, samples_per_pixel: int, seeds: range) -> tuple[np.ndarray, list[float]]:
        """Images of shape (seeds, rows, columns, 3), and the CPU seconds of each.

        CPU seconds are the process's, user and system, over all threads. Before them the same
        kernel renders once: compilation is not in them. Nor is the tracing of Python, which a
        frozen function does once.
        """

        @dr.freeze
        def frozen(scene, seed):
            return mi.render(scene, spp=samples_per_pixel, seed=seed)

        # The first call compiles; of short ones the second, the first to replay, is slower too.
        for warm_up in range(2 if len(seeds) > 1 else 1):
            self._finish(frozen(self.scene, mi.UInt32(seeds.stop + warm_up)))
        images, cpu_seconds = [], []
        for seed in seeds:
            begin = time.process_time()
            image = frozen(self.scene, mi.UInt32(seed))
            self._finish(image)
            cpu_seconds.append(time.process_time() - begin)
            images.append(np.array(image, dtype=np.float64))
        frozen.clear()
        gc.collect()
        return np.stack(images), cpu_seconds

    @staticmethod
    def _finish(image):
        dr.eval(image)
        dr.sync_thread()
