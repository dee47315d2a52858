//! Four corners that a person marked in a photograph, and the maps that they define.

use export::rectify::Homography;
use nalgebra::Matrix3;
use std::str::FromStr;

/// Corners may lie beside a photograph, but no further from it than any photograph is large.
const COORDINATE_MAX: f64 = 1e6;

/// The corners of a rectangle in an image, in pixels from the image's top left corner: near left,
/// near right, far right, far left. In the image they go round counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corners(pub [[f64; 2]; 4]);

impl FromStr for Corners {
    type Err = String;

    /// Reads eight numbers, x and y of each corner, with commas or spaces between.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let words = text.split([',', ' ', ';']).filter(|word| !word.is_empty());
        let numbers = words.map(|word| {
            let number = word.parse::<f64>().ok();
            let number = number.filter(|number| number.abs() <= COORDINATE_MAX);
            number.ok_or_else(|| format!("{word:?} is no place in a photograph"))
        });
        let numbers: Vec<f64> = numbers.collect::<Result<_, _>>()?;
        let [x0, y0, x1, y1, x2, y2, x3, y3] = numbers[..] else {
            let count = numbers.len();
            return Err(format!("four corners are eight numbers, not {count}"));
        };
        let corners = Self([[x0, y0], [x1, y1], [x2, y2], [x3, y3]]);
        match corners.are_sound() {
            true => Ok(corners),
            false => Err(
                "the corners cross, go the wrong way round or span no pixel: give near left, near right, far \
                 right, far left"
                    .to_owned(),
            ),
        }
    }
}

impl Corners {
    /// Whether they go round once, counter-clockwise as one sees the image, without a corner that
    /// points inwards.
    pub fn are_convex(&self) -> bool {
        (0..4).all(|corner| {
            let [a, b, c] = [0, 1, 2].map(|next| self.0[(corner + next) % 4]);
            // Rows grow downwards.
            (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]) < 0.0
        })
    }

    /// Whether they are convex and span a pixel at least: only then are there maps.
    pub fn are_sound(&self) -> bool {
        let numbers = self.0.iter().flatten();
        let places = numbers.clone().all(|at| at.abs() <= COORDINATE_MAX);
        places && self.are_convex() && self.area() >= 1.0
    }

    /// The area inside, in pixels.
    pub fn area(&self) -> f64 {
        let pairs = (0..4).map(|corner| (self.0[corner], self.0[(corner + 1) % 4]));
        let twice: f64 = pairs.map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum();
        0.5 * twice.abs()
    }

    /// Takes (s, t, 1), s to the right and t away from the camera, 0 to 1 across the rectangle, to
    /// pixels (Heckbert 1989, "Fundamentals of texture mapping and image warping", section 2.2.3).
    fn matrix(&self) -> Matrix3<f64> {
        let [[x0, y0], [x1, y1], [x2, y2], [x3, y3]] = self.0;
        let (sum_x, sum_y) = (x0 - x1 + x2 - x3, y0 - y1 + y2 - y3);
        let (dx1, dx2, dy1, dy2) = (x1 - x2, x3 - x2, y1 - y2, y3 - y2);
        let determinant = dx1 * dy2 - dx2 * dy1;
        let g = (sum_x * dy2 - dx2 * sum_y) / determinant;
        let h = (dx1 * sum_y - sum_x * dy1) / determinant;
        Matrix3::new(
            x1 - x0 + g * x1,
            x3 - x0 + h * x3,
            x0,
            y1 - y0 + g * y1,
            y3 - y0 + h * y3,
            y0,
            g,
            h,
            1.0,
        )
    }

    /// Takes (s, t, 1) to pixels (x w, y w, w), with w above 0 inside the rectangle.
    pub fn image_from_square(&self) -> Homography {
        rows(&self.matrix())
    }

    /// Takes pixels (x, y, 1) to (s w, t w, w), with w above 0 inside the corners. Of corners that
    /// are sound.
    pub fn square_from_image(&self) -> Homography {
        let matrix = self.matrix();
        let Some(inverse) = matrix.try_inverse() else {
            unreachable!("sound corners have an area");
        };
        rows(&inverse)
    }
}

fn rows(matrix: &Matrix3<f64>) -> Homography {
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
}

/// A point mapped; `None` beyond the map's horizon.
pub fn project(map: &Homography, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let [u, v, w] = map.map(|line| line[0] * x + line[1] * y + line[2]);
    (w > 0.0).then(|| [u / w, v / w])
}

/// First `inner`, then `outer`.
pub fn compose(outer: &Homography, inner: &Homography) -> Homography {
    std::array::from_fn(|row| {
        std::array::from_fn(|column| (0..3).map(|k| outer[row][k] * inner[k][column]).sum())
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn corners(moved: [[f64; 2]; 4]) -> Corners {
        let base = [[20.0, 90.0], [100.0, 90.0], [100.0, 10.0], [20.0, 10.0]];
        Corners(std::array::from_fn(|corner| {
            [0, 1].map(|axis| base[corner][axis] + moved[corner][axis])
        }))
    }

    proptest! {
        #[test]
        fn corners_map_to_the_square_and_back(
            moved in prop::array::uniform4(prop::array::uniform2(-19.0..19.0_f64)),
            s in 0.0..=1.0_f64,
            t in 0.0..=1.0_f64,
        ) {
            let corners = corners(moved);
            prop_assert!(corners.are_convex());
            let (forth, back) = (corners.image_from_square(), corners.square_from_image());
            for (corner, square) in corners.0.into_iter().zip([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) {
                let found = project(&back, corner).unwrap();
                prop_assert!((0..2).all(|axis| (found[axis] - square[axis]).abs() < 1e-9));
            }
            let there = project(&forth, [s, t]).unwrap();
            let again = project(&back, there).unwrap();
            prop_assert!((again[0] - s).abs() < 1e-9 && (again[1] - t).abs() < 1e-9);
        }
    }

    #[test]
    fn texts_are_eight_numbers_that_go_round() {
        let read = |text: &str| text.parse::<Corners>();
        let good = read("20,90 100,90 100,10 20,10").unwrap();
        assert_eq!(good, corners([[0.0; 2]; 4]));
        assert_eq!(good.area(), 6400.0);
        assert_eq!(read("20,90,100,90,100,10,20,10"), Ok(good));
        let crossed = read("20,90 100,10 100,90 20,10").unwrap_err();
        assert!(crossed.contains("cross"), "{crossed}");
        let mirrored = read("100,90 20,90 20,10 100,10").unwrap_err();
        assert!(mirrored.contains("wrong way"), "{mirrored}");
        assert!(read("1,2,3").unwrap_err().contains("not 3"));
        assert!(read("1,2,3,4,5,6,7,x").unwrap_err().contains("\"x\""));
        assert!(read("1,2,3,4,5,6,7,inf").unwrap_err().contains("inf"));
        assert!(read("").is_err());
        assert!(read("0,1e9 1,1 1,0 0,0").unwrap_err().contains("1e9"));
        assert!(read("0,1e-160 1e-160,1e-160 1e-160,0 0,0").is_err());
        assert!(read("0,0 1,1 2,2 3,3").is_err());
    }
}
