//! Numbers on pictures: ten digits of five by three dots.

use super::canvas::Canvas;

/// The side of a dot in pixels.
const DOT: u32 = 2;

/// The height of a number in pixels.
pub const HEIGHT: u32 = 5 * DOT;

/// Five rows of three dots each, the leftmost dot the highest bit.
const SHAPES: [[u8; 5]; 10] = [
    [0b111, 0b101, 0b101, 0b101, 0b111],
    [0b010, 0b110, 0b010, 0b010, 0b111],
    [0b111, 0b001, 0b111, 0b100, 0b111],
    [0b111, 0b001, 0b111, 0b001, 0b111],
    [0b101, 0b101, 0b111, 0b001, 0b001],
    [0b111, 0b100, 0b111, 0b001, 0b111],
    [0b111, 0b100, 0b111, 0b101, 0b111],
    [0b111, 0b001, 0b010, 0b010, 0b010],
    [0b111, 0b101, 0b111, 0b101, 0b111],
    [0b111, 0b101, 0b111, 0b001, 0b111],
];

/// The width of `number` in pixels.
pub fn width(number: u32) -> u32 {
    (4 * number.to_string().len() as u32 - 1) * DOT
}

/// Writes `number` with its upper left corner at (`left`, `top`); what does not fit is cut off.
pub fn draw(picture: &mut Canvas, number: u32, left: u32, top: u32) {
    const INK: [u8; 3] = [200; 3];
    for (place, digit) in (0..).zip(number.to_string().bytes()) {
        let shape = SHAPES[usize::from(digit - b'0')];
        for (row, dots) in (0..).zip(shape) {
            for column in (0..3u32).filter(|column| dots >> (2 - column) & 1 == 1) {
                let (x, y) = (left + (4 * place + column) * DOT, top + row * DOT);
                for (dx, dy) in (0..DOT * DOT).map(|i| (i % DOT, i / DOT)) {
                    picture.put(x + dx, y + dy, INK);
                }
            }
        }
    }
}
