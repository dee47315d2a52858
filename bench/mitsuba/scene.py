"""A view of a specification as a scene of Mitsuba, in millimetres.

Millimetres, because Mitsuba moves the origin of a scattered ray off its surface by an amount that
depends on the size of the coordinates' numbers, and in metres that amount moves reflections by a
tenth of a pixel.
"""

import math

import mitsuba as mi
import numpy as np

MILLIMETRES = 1000.0


def _place(distance_m, elevation_deg, side):
    elevation = math.radians(elevation_deg)
    distance = MILLIMETRES * distance_m
    # From straight above, the cosine of a right angle in floating point is not zero.
    along = 0.0 if elevation_deg == 90 else math.cos(elevation)
    return [0.0, side * distance * along, distance * math.sin(elevation)]


def _linear_from_srgb8(code):
    encoded = code / 255
    return encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4


def _chart(checker):
    pitch = MILLIMETRES * checker["pitch_m"]
    columns, rows = checker["columns"], checker["rows"]
    patches = np.array(
        [[_linear_from_srgb8(code) for code in patch] for patch in checker["patches_srgb8"]],
        dtype=np.float32,
    ).reshape(rows, columns, 3)
    # The specification begins with the far row, a rectangle's v with the near one.
    patches = np.ascontiguousarray(patches[::-1])
    to_world = (
        mi.ScalarTransform4f()
        .translate([0, MILLIMETRES * checker["lower_edge_y_m"], 0])
        .rotate([1, 0, 0], checker["tilt_deg"])
        .translate([0, 0.5 * rows * pitch, 0])
        .scale([0.5 * columns * pitch, 0.5 * rows * pitch, 1])
    )
    return {
        "type": "rectangle",
        "to_world": to_world,
        "bsdf": {
            "type": "diffuse",
            "reflectance": {
                "type": "bitmap",
                "bitmap": mi.Bitmap(patches),
                "filter_type": "nearest",
                "wrap_mode": "clamp",
                "raw": True,
            },
        },
    }


def _square(side_m):
    scale = [0.5 * MILLIMETRES * side_m] * 2 + [1]
    return {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale(scale)}


def _mesh(path, side_m):
    """A PLY file, placed as the program places it."""
    box = mi.load_dict({"type": "ply", "filename": str(path)}).bbox()
    lower, upper = (np.array(corner, dtype=np.float64) for corner in (box.min, box.max))
    scale = MILLIMETRES * side_m / float((upper - lower).max())
    middle = 0.5 * (lower + upper)
    to_world = (
        mi.ScalarTransform4f()
        .scale(scale)
        .translate([-float(middle[0]), -float(middle[1]), -float(upper[2])])
    )
    return {"type": "ply", "filename": str(path), "to_world": to_world}


def load(specification, view_index, material, mesh=None):
    """The scene of a view with a material on the sample: both as the program writes them. `mesh` is the path
    of a PLY file that is the sample instead of the square."""
    if specification["tint"] != "hue":
        raise ValueError("the plugin knows the tint hue only")
    view = specification["views"][view_index]
    camera, light, image = (specification[name] for name in ("camera", "light", "image"))
    elevation_deg = view["camera_elevation_deg"]
    side_m = specification["sample"]["side_m"]
    sample = _mesh(mesh, side_m) if mesh else _square(side_m)
    up = [0, 1, 0] if elevation_deg == 90 else [0, 0, 1]
    to_world = mi.ScalarTransform4f().look_at(
        _place(camera["distance_m"], elevation_deg, -1), [0, 0, 0], up
    )
    description = {
        "type": "scene",
        "integrator": {
            "type": "path",
            # Mitsuba counts the path's segments up to the light, brdfarm its surfaces.
            "max_depth": specification["integrator"]["max_bounces"] + 1,
            "rr_depth": 1000,
        },
        "sensor": {
            "type": "perspective",
            "to_world": to_world,
            "fov": math.degrees(2 * math.atan(camera["film_half_width"])),
            "fov_axis": "x",
            "near_clip": 1.0,
            "far_clip": 1e5,
            "film": {
                "type": "hdrfilm",
                "width": image["width"],
                "height": image["height"],
                "rfilter": {"type": "box"},
                "pixel_format": "rgb",
                "component_format": "float32",
            },
            "sampler": {"type": "multijitter"},
        },
        "bulb": {
            "type": "sphere",
            "center": _place(light["distance_m"], view["light_elevation_deg"], 1),
            "radius": MILLIMETRES * light["radius_m"],
            "emitter": {
                "type": "area",
                "radiance": {
                    "type": "rgb",
                    "value": [(light["distance_m"] / light["radius_m"]) ** 2] * 3,
                },
            },
        },
        "sample": {
            **sample,
            "bsdf": {
                "type": "brdfarm",
                **material,
                "angle_deg": material["angle_deg"] + view["rotation_deg"],
            },
        },
    }
    if view["checker"]:
        description["chart"] = _chart(specification["checker"])
    return mi.load_dict(description)
