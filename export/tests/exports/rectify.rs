use dataset::{Specification, specification::Shape};
use export::rectify::{Rectifier, RectifyError};

/// Every pixel weighs as much as it shows of the sample: a constant stays constant.
#[test]
fn a_constant_stays_constant() {
    let specification = Specification::preset();
    let film = vec![[0.5, 0.25, 3.0]; 128 * 128];
    for view in 0..14 {
        for side in [1, 17, 64, 256] {
            let rectifier = Rectifier::new(&specification, view, side).unwrap();
            // Away from the border, where the film saw no black.
            for (place, value) in rectifier.apply(&film).iter().enumerate() {
                let (row, column) = (place as u32 / side, place as u32 % side);
                let border = 5.max(side / 8);
                if (row.min(column) < border) || (side - row.max(column)) <= border {
                    continue;
                }
                for (value, expected) in value.iter().zip(film[0]) {
                    assert!((value - expected).abs() < 1e-4 * expected);
                }
            }
        }
    }
}

#[test]
fn what_cannot_be_rectified_is_refused() {
    let mut specification = Specification::preset();
    let refused =
        |specification: &Specification, view, side| Rectifier::new(specification, view, side).err();
    assert_eq!(refused(&specification, 0, 0), Some(RectifyError::Side(0)));
    assert_eq!(
        refused(&specification, 14, 8),
        Some(RectifyError::NoSuchView(14))
    );
    assert!(refused(&specification, 8, 2049).is_some());
    specification.sample.shape = Shape::Sphere;
    assert_eq!(refused(&specification, 8, 8), Some(RectifyError::Curved));
    specification.sample.shape = Shape::Square;
    specification.camera.film_half_width = 0.06;
    assert_eq!(refused(&specification, 8, 8), Some(RectifyError::Unseen(8)));
    // A film that is wide enough to see the horizon: its pixels up there are none of the sample.
    specification.camera.film_half_width = 2.0;
    assert_eq!(refused(&specification, 4, 8), None);
}
