//! What people write on command lines beside names and numbers.

use dataset::condition::Condition;
use dataset::{IndexList, Specification};

/// Reads a list of indices.
pub fn index_list(bytes: &[u8]) -> bool {
    const COUNT: u32 = 1000;
    let Ok(list) = str::from_utf8(bytes)
        .unwrap_or_default()
        .parse::<IndexList>()
    else {
        return false;
    };
    assert_eq!(list.to_string().parse(), Ok(list.clone()));
    if let Ok(indices) = list.below(COUNT, "material") {
        assert!(indices.len() <= COUNT as usize);
        assert!(indices.iter().all(|index| *index < COUNT));
    }
    assert!(list.below(0, "material").is_err());
    true
}

/// Reads a condition on labels.
pub fn condition(bytes: &[u8]) -> bool {
    let text = str::from_utf8(bytes).unwrap_or_default();
    let Ok(condition) = text.parse::<Condition>() else {
        return false;
    };
    assert_eq!(condition.to_string().parse(), Ok(condition.clone()));
    // One level more may be one too many.
    let Ok(denied) = format!("not ({condition})").parse::<Condition>() else {
        return true;
    };
    let set = Specification::preset();
    for index in 0..6 {
        let (material, split) = (set.material(index), set.split(index));
        let holds = condition.holds(&material, split);
        assert_ne!(denied.holds(&material, split), holds);
    }
    true
}
