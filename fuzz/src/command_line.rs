//! What people write on command lines beside names and numbers.

use dataset::IndexList;

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
