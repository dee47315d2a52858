"""What the Python package costs beside the same work in Rust, in NumPy and in Mitsuba.

    cargo build --release --example peer -p renderer
    pip install target/wheels/brdfarm-*.whl mitsuba==3.9.0
    python bench/python/measure.py target/release/examples/peer

`evaluate` of a million pairs of directions, and view 5 of the preset's first eight materials. Rounds
are interleaved; what is printed is the quickest of each. NumPy evaluates the same formulas over whole
arrays. Mitsuba evaluates them as the BSDF of `bench/mitsuba/reflectance.py`, in 32 bits, compiled by
LLVM for all cores; without Mitsuba that line is left out.
"""

import json
import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import brdfarm

COUNT = 1_000_000
ROUNDS = 9
PARAMETERS = dict(
    roughness=12.0, anisotropy=0.4, angle_deg=30.0, ior=1.6, rgb0=(0.8, 0.4, 0.2), rgb90=(1, 1, 1)
)
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def directions(count, phase):
    """Over the hemisphere, by the golden ratio; as in renderer/examples/peer.rs."""
    index = np.arange(count)
    z = (index + 0.5) / count
    angle = phase + index * 2.399963229728653
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)


def evaluate(wi, wo, *, roughness, anisotropy, angle_deg, ior, rgb0, rgb90):
    """The model in NumPy, for a roughness up to 90 and directions above the surface."""
    wi = wi / np.linalg.norm(wi, axis=-1, keepdims=True)
    wo = wo / np.linalg.norm(wo, axis=-1, keepdims=True)
    base = 0.001 + 0.00999 * roughness
    n_u, n_v = base**-3, (base + anisotropy**3) ** -3
    cos_psi, sin_psi = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    half = wi + wo
    u, v = cos_psi * half[:, 0] + sin_psi * half[:, 1], cos_psi * half[:, 1] - sin_psi * half[:, 0]
    tangential = u * u + v * v
    exponent = (n_u * u * u + n_v * v * v) / tangential
    power = np.exp(-0.5 * exponent * np.log1p(tangential / half[:, 2] ** 2))
    length = np.linalg.norm(half, axis=-1)
    cos_i, cos_o = wi[:, 2], wo[:, 2]
    specular = math.sqrt((n_u + 1) * (n_v + 1)) / (8 * math.pi) * power
    specular /= 0.5 * length * np.maximum(cos_i, cos_o)
    a, c = (ior - cos_i) / (ior + cos_i), (ior * cos_i - 1) / (ior * cos_i + 1)
    fresnel = (0.5 * (a * a + c * c))[:, None]
    colour = np.asarray(rgb90) * (1 - cos_o)[:, None] + np.asarray(rgb0) * cos_o[:, None]
    chromaticity = colour / colour.max(axis=-1, keepdims=True)
    brightest = fresnel / (chromaticity @ LUMINANCE)[:, None]
    saturation = (1 - fresnel) / np.where(brightest > 1, brightest - fresnel, 1)
    moved = fresnel + saturation * (chromaticity * brightest - fresnel)
    return np.where(brightest <= 1, chromaticity * brightest, moved) * specular[:, None]


def mitsuba_evaluate(wi, wo):
    """Evaluates in Mitsuba; None where that is not installed."""
    try:
        import mitsuba as mi
    except ImportError:
        return None
    mi.set_variant("llvm_ad_rgb")
    sys.path.insert(0, str(Path(__file__).parents[1] / "mitsuba"))
    import drjit as dr
    from reflectance import Reflectance

    mi.register_bsdf("brdfarm", Reflectance)
    colours = {name: {"type": "rgb", "value": list(PARAMETERS[name])} for name in ("rgb0", "rgb90")}
    bsdf = mi.load_dict({"type": "brdfarm", **PARAMETERS, **colours})
    interaction = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    interaction.wi = mi.Vector3f(np.ascontiguousarray(wo.T))
    light = mi.Vector3f(np.ascontiguousarray(wi.T))

    def work():
        value = bsdf.eval(mi.BSDFContext(), interaction, light)
        dr.eval(value)
        dr.sync_thread()
        return np.array(value)

    return work


def seconds(work):
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def rust(program, *arguments):
    said = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True, check=True)
    return min(json.loads(said.stdout))


def compare(name, peers):
    """Prints the quickest of interleaved rounds of each, and its ratio to Rust's."""
    rounds = [[peer() for peer in peers.values()] for _ in range(ROUNDS)]
    quickest = dict(zip(peers, (min(column) for column in zip(*rounds, strict=True)), strict=True))
    for peer, spent in quickest.items():
        print(f"{name:<9} {peer:<8} {1e3 * spent:9.1f} ms, {spent / quickest['Rust']:7.3f} of Rust's")


def main(program):
    wi, wo = directions(COUNT, 0.0), directions(COUNT, 1.0)
    material = brdfarm.Material(**PARAMETERS)
    assert np.allclose(material.evaluate(wi, wo), evaluate(wi, wo, **PARAMETERS), rtol=1e-9)
    peers = {
        "Rust": lambda: rust(program, "evaluate", COUNT, 2),
        "Python": lambda: seconds(lambda: material.evaluate(wi, wo)),
        "NumPy": lambda: seconds(lambda: evaluate(wi, wo, **PARAMETERS)),
    }
    if (mitsuba := mitsuba_evaluate(wi, wo)) is not None:
        expected = material.evaluate(wi, wo) * wi[:, 2:]
        found = np.asarray(mitsuba()).reshape(3, -1).T
        assert np.allclose(found, expected, rtol=2e-2, atol=1e-5)
        peers["Mitsuba"] = lambda: seconds(mitsuba)
    compare("evaluate", peers)
    spec = brdfarm.Specification.preset()
    materials = [spec.material(index) for index in range(8)]
    brdfarm.render(spec, materials[0], 5)
    compare(
        "render",
        {
            "Rust": lambda: rust(program, "render", 1),
            "Python": lambda: seconds(lambda: [brdfarm.render(spec, one, 5) for one in materials]),
        },
    )


main(*sys.argv[1:])
