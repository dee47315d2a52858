"""Traces the rays of `renderer/examples/rays.rs` with Embree's own 32-bit triangles and with Mitsuba's, on
one thread: prints a line of JSON for each.

    python peers.py MESH RAYS embree|mitsuba
"""

import json
import statistics
import sys
import time

import numpy as np

ROUNDS = 5


def resident_mebibytes():
    with open("/proc/self/status", encoding="ascii") as status:
        line = next(line for line in status if line.startswith("VmRSS:"))
    return int(line.split()[1]) / 1024


def load(mesh_path, rays_path):
    data = np.fromfile(mesh_path, dtype="<u4")
    count = int(data[0])
    vertices = data[1 : 1 + 3 * count].view("<f4").reshape(-1, 3)
    triangles = data[1 + 3 * count :].reshape(-1, 3)
    rays = np.fromfile(rays_path, dtype="<f4").reshape(-1, 2, 3)
    return vertices, triangles, np.ascontiguousarray(rays[:, 0]), np.ascontiguousarray(rays[:, 1])


def embree(vertices, triangles):
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, vertices, triangles.astype(np.int32))
    first = np.zeros((1, 3), dtype=np.float32)
    scene.run(first, first + 1)  # commits

    def trace(origins, directions):
        return int((scene.run(origins, directions) >= 0).sum())

    return trace


def mitsuba(vertices, triangles):
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    dr.set_thread_count(1)
    mesh = mi.Mesh("torus", len(vertices), len(triangles))
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = vertices.ravel()
    parameters["faces"] = triangles.ravel()
    parameters.update()
    scene = mi.load_dict({"type": "scene", "mesh": mesh})

    def trace(origins, directions):
        o, d = (mi.Vector3f(values.T) for values in (origins, directions))
        dr.eval(o, d)
        found = scene.ray_intersect_preliminary(mi.Ray3f(o, d), coherent=False)
        return int(dr.count(found.is_valid())[0])

    return trace


def main():
    mesh_path, rays_path, name = sys.argv[1:]
    vertices, triangles, origins, directions = load(mesh_path, rays_path)
    before = resident_mebibytes()
    begin = time.perf_counter()
    trace = {"embree": embree, "mitsuba": mitsuba}[name](vertices, triangles)
    hits = trace(origins, directions)
    build = time.perf_counter() - begin
    mebibytes = resident_mebibytes() - before
    seconds = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        trace(origins, directions)
        seconds.append(time.perf_counter() - begin)
    rate = len(origins) / statistics.median(seconds)
    print(
        json.dumps(
            {
                "rays_a_second": round(rate),
                "build_seconds": round(build, 2),
                "mebibytes": round(mebibytes),
                "hits": hits,
            }
        )
    )


if __name__ == "__main__":
    main()
