//! A specification with one view, a material, and how to render the two again.

use dataset::{Material, Specification};
use renderer::{geometry::BackendChoice, hybrid::PreparedView, scene::Scene};
use serde_json::Value;
use std::fmt::Write;

/// What is rendered: the specification's only view, of one material.
#[derive(Clone, Debug)]
pub struct Case {
    pub specification: Specification,
    pub material: Material,
}

impl Case {
    /// The case with its specification read back from TOML: `None` where the specification's own
    /// checks refuse it, and why.
    pub fn admitted(specification: &Specification, material: Material) -> Result<Self, String> {
        material.check().map_err(|error| error.to_string())?;
        let text = toml_of(specification);
        let read = Specification::from_toml(&text, "drawn").map_err(|error| error.to_string())?;
        assert_eq!(read, *specification, "a TOML file loses nothing:\n{text}");
        Ok(Self {
            specification: read,
            material,
        })
    }

    /// The case of a TOML text, and view `view` of it.
    pub fn of_toml(text: &str, view: usize, material: Material) -> Self {
        let mut specification = Specification::from_toml(text, "case").expect("a specification");
        specification.views = vec![specification.views[view].clone()];
        Self::admitted(&specification, material).expect("an admitted case")
    }

    /// Whether the hybrid integrator takes the view.
    pub fn is_worked_out(&self) -> bool {
        let scene = Scene::new(&self.specification, 0, BackendChoice::Native)
            .expect("a view")
            .expect("native geometry");
        PreparedView::new(&scene, &self.specification).is_some()
    }

    /// The same on a film with `factor` times the columns and rows.
    pub fn magnified(&self, factor: u32) -> Specification {
        let mut specification = self.specification.clone();
        specification.image.width *= factor;
        specification.image.height *= factor;
        specification
    }

    /// The same to a tolerance `factor` times smaller, as far as the limits allow.
    pub fn tightened(&self, factor: f64) -> Specification {
        const ABSOLUTE_MIN: f64 = 1e-9;
        let mut specification = self.specification.clone();
        let accuracy = &mut specification.accuracy;
        accuracy.absolute = (accuracy.absolute / factor).max(ABSOLUTE_MIN);
        accuracy.relative /= factor;
        specification
    }

    /// Two files and the command that renders them.
    pub fn reproduction(&self) -> String {
        let material = serde_json::to_string(&self.material).expect("a material is JSON");
        format!(
            "cat >case.toml <<'TOML'\n{}TOML\ncat >case.json <<'JSON'\n{material}\nJSON\n\
             brdfarm render --spec case.toml --material-file case.json --view 0 --out case.exr\n",
            toml_of(&self.specification)
        )
    }
}

/// What differs from the preset, as TOML. JSON's scalars and lists of them are TOML's, too.
pub fn toml_of(specification: &Specification) -> String {
    let tree = |specification| serde_json::to_value(specification).expect("a tree");
    let (found, preset) = (tree(specification), tree(&Specification::preset()));
    let (mut scalars, mut tables) = (String::new(), String::new());
    for (key, value) in found.as_object().expect("a table") {
        if *value == preset[key] {
            continue;
        }
        match value {
            Value::Object(fields) => {
                _ = writeln!(tables, "[{key}]");
                for (field, value) in fields {
                    if *value != preset[key][field] {
                        _ = writeln!(tables, "{field} = {value}");
                    }
                }
            }
            Value::Array(views) => {
                for view in views {
                    _ = writeln!(tables, "[[{key}]]");
                    for (field, value) in view.as_object().expect("a view is a table") {
                        _ = writeln!(tables, "{field} = {value}");
                    }
                }
            }
            scalar => _ = writeln!(scalars, "{key} = {scalar}"),
        }
    }
    scalars + &tables
}
