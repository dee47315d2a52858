"""Writes a cloth that lies over a ball and hangs in folds, as a PLY file with normals and texture
coordinates: a sample for `sample.shape = "mesh"`.

    python3 examples/cloth.py cloth.ply [SIDE]

SIDE is the number of quadrilaterals along each side, 128 without it. u grows along x, and so does the
x axis of a material's frame.
"""

import math
import sys

STEP = 1e-5


def height(x, y):
    """Over the square from -1 to 1, z up."""
    outward = math.hypot(x, y)
    around = math.atan2(y, x)
    # As over a ball in the middle, steep at the rim.
    drop = 0.9 * outward * outward / (1 + 0.5 * outward)
    # Folds begin where the ball ends.
    free = max(0.0, outward - 0.3)
    folds = 0.35 * free * free / (0.4 + free) * math.cos(8 * around + 1.5 * outward)
    return -drop + folds


def normal(x, y):
    """The unit normal, by differences."""
    by_x = (height(x + STEP, y) - height(x - STEP, y)) / (2 * STEP)
    by_y = (height(x, y + STEP) - height(x, y - STEP)) / (2 * STEP)
    length = math.sqrt(1 + by_x * by_x + by_y * by_y)
    return -by_x / length, -by_y / length, 1 / length


def write(path, side):
    """Writes the cloth with `side` x `side` quadrilaterals, each split in two."""
    with open(path, "w", encoding="ascii") as file:
        names = ["x", "y", "z", "nx", "ny", "nz", "u", "v"]
        file.write("ply\nformat ascii 1.0\n")
        file.write(f"element vertex {(side + 1) ** 2}\n")
        file.writelines(f"property double {name}\n" for name in names)
        file.write(f"element face {2 * side * side}\n")
        file.write("property list uchar uint vertex_indices\nend_header\n")
        for row in range(side + 1):
            for column in range(side + 1):
                u, v = column / side, row / side
                x, y = 2 * u - 1, 2 * v - 1
                numbers = (x, y, height(x, y), *normal(x, y), u, v)
                file.write(" ".join(f"{number:.9g}" for number in numbers) + "\n")
        for row in range(side):
            for column in range(side):
                a = row * (side + 1) + column
                b, c, d = a + 1, a + side + 2, a + side + 1
                file.write(f"3 {a} {b} {c}\n3 {a} {c} {d}\n")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    write(sys.argv[1], int(sys.argv[2]) if len(sys.argv) == 3 else 128)
