use super::*;
use crate::Specification;
use proptest::prelude::*;

/// The materials of the preset's first 300 for which a condition holds.
fn chosen(condition: &str) -> Vec<u32> {
    let set = Specification::preset();
    let condition: Condition = condition.parse().unwrap();
    (0..300)
        .filter(|index| condition.holds(&set.material(*index), set.split(*index)))
        .collect()
}

fn filtered(holds: impl Fn(&SampledMaterial, Split) -> bool) -> Vec<u32> {
    let set = Specification::preset();
    (0..300)
        .filter(|index| holds(&set.material(*index), set.split(*index)))
        .collect()
}

#[test]
fn conditions_choose_what_they_say() {
    let rough =
        filtered(|sampled, split| sampled.material.roughness < 20.0 && split == Split::Train);
    assert!(rough.len() > 20 && rough.len() < 100);
    for same in [
        "roughness < 20 and split == 'train'",
        "20>roughness and\tsplit==\"train\"",
        "not (roughness >= 2e1 or split != 'train')",
        "not not roughness < 20 and (split == 'train' and (ior > 0 or ior <= 0))",
    ] {
        assert_eq!(chosen(same), rough, "{same}");
    }
    assert_eq!(chosen("material >= 7 and material <= 9"), [7, 8, 9]);
    let green = filtered(|sampled, _| sampled.material.rgb0[1] > sampled.material.rgb90[1]);
    assert_eq!(chosen("rgb0_linear_1 > rgb90_linear_1"), green);
    let light = filtered(|sampled, _| sampled.lab90()[0] > 50.0);
    assert_eq!(chosen("rgb90_lab_0 > 50"), light);
    // `and` binds closer than `or`.
    let either = "material == 1 or material == 2 and split == 'none'";
    assert!(
        either
            .parse::<Condition>()
            .unwrap_err()
            .contains("no split 'none'")
    );
    assert_eq!(
        chosen("material == 1 or material == 2 and material == 3"),
        [1]
    );
}

#[test]
fn what_is_wrong_is_said() {
    for (text, why) in [
        ("", "a value is missing"),
        ("roughness", "comparison is missing"),
        ("roughness = 3", "write =="),
        ("roughness < ", "a value is missing"),
        ("roughness < 3 ior > 2", "`and` or `or` is missing"),
        ("(roughness < 3", "`)` is missing"),
        ("roughness < 'a'", "cannot be compared"),
        ("'a' == 'b`'", "no label"),
        ("split == 'train", "not closed"),
        ("rouhgness < 3", "no label"),
        ("split == train", "no label"),
        ("rgb0_linear < 3", "no label"),
        ("roughness < inf", "no label"),
        ("roughness ~ 3", "no comparison"),
    ] {
        let said = text.parse::<Condition>().unwrap_err();
        assert!(said.contains(why), "{text:?}: {said}");
    }
    let deep = format!("{}ior > 1{}", "(".repeat(100_000), ")".repeat(100_000));
    assert!(deep.parse::<Condition>().unwrap_err().contains("nested"));
}

proptest! {
    /// Whatever is typed is a condition or is refused.
    #[test]
    fn nothing_that_is_typed_panics(text in "([a-z_0-9'\"<>=!() .é]|and|or|not|ior|split|[0-9]){0,60}") {
        if let Ok(condition) = text.parse::<Condition>() {
            let set = Specification::preset();
            condition.holds(&set.material(3), set.split(3));
            let again: Condition = condition.to_string().parse().unwrap();
            prop_assert_eq!(again, condition);
        }
    }

    /// De Morgan's laws hold of all that is read.
    #[test]
    fn not_and_is_or_not(a in -10.0..120.0_f64, b in 0.5..8.0_f64, index in 0_u32..300) {
        let set = Specification::preset();
        let holds = |text: String| {
            let condition: Condition = text.parse().unwrap();
            condition.holds(&set.material(index), set.split(index))
        };
        let one = holds(format!("not (roughness < {a} and ior >= {b})"));
        let other = holds(format!("not roughness < {a} or not ior >= {b}"));
        prop_assert_eq!(one, other);
    }
}
