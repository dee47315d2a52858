//! The materials on which a renderer goes wrong.

use dataset::Material;

const BASE: Material = Material {
    roughness: 30.0,
    anisotropy: 0.5,
    angle_deg: 40.0,
    ior: 2.0,
    rgb0: [0.8, 0.5, 0.3],
    rgb90: [0.9, 0.9, 0.9],
};

/// Each with what makes it hard.
pub fn hard_materials() -> Vec<(&'static str, Material)> {
    let with = |roughness, anisotropy| Material {
        roughness,
        anisotropy,
        ..BASE
    };
    vec![
        ("ordinary", BASE),
        ("mirror, exponent 1e9", with(0.0, 0.0)),
        ("brushed mirror, exponents 1e9 and 1", with(0.0, 1.0)),
        ("just specular", with(90.0, 0.3)),
        ("first trace of Lambert", with(90.000_001, 0.3)),
        ("half Lambert", with(95.0, 0.3)),
        ("all Lambert", with(100.0, 0.3)),
        ("no reflection at the normal", Material { ior: 1.0, ..BASE }),
        (
            "the most reflective",
            Material {
                ior: 10.0,
                ..with(5.0, 0.0)
            },
        ),
        (
            "black",
            Material {
                rgb0: [0.0; 3],
                rgb90: [0.0; 3],
                ..BASE
            },
        ),
        (
            "pure blue to pure yellow",
            Material {
                rgb0: [0.0, 0.0, 1.0],
                rgb90: [1.0, 1.0, 0.0],
                ior: 8.0,
                ..BASE
            },
        ),
        (
            "angle at the end of its period",
            Material {
                angle_deg: 180.0,
                ..BASE
            },
        ),
    ]
}
