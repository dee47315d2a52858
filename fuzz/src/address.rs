//! What a browser sends: addresses, forms and cookies.

use coordinator::security::Tokens;
use dataset::Specification;
use std::sync::LazyLock;

static SPECIFICATION: LazyLock<Specification> = LazyLock::new(Specification::preset);

static TOKENS: LazyLock<Tokens> = LazyLock::new(|| {
    let [operator, reader] = ["o", "r"].map(|letter| letter.repeat(32));
    format!("operator {operator}\nreader {reader}")
        .parse()
        .unwrap()
});

/// Reads the query of an address, a form, and a cookie.
pub fn address(bytes: &[u8]) -> bool {
    web::outside::read(bytes, &SPECIFICATION, &TOKENS)
}
