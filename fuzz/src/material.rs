//! Materials as JSON.

use dataset::Material;
use renderer::query;

/// Reads a material, and a question about one, whose answer has to be a radiance ratio.
pub fn material(bytes: &[u8]) -> bool {
    let material = Material::from_json(bytes);
    if let Ok(material) = &material {
        let json = serde_json::to_vec(material).unwrap();
        assert_eq!(Material::from_json(&json).unwrap(), *material);
    }
    let answer = query::answer(bytes);
    if let Ok(f) = &answer {
        assert!(f.iter().all(|f| f.is_finite() && *f >= 0.0), "{f:?}");
    }
    material.is_ok() || answer.is_ok()
}
