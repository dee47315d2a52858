//! What each field of a specification reads from a TOML value.

use super::{
    Accuracy, Camera, Checker, Image, Integrator, IntegratorKind, Light, Parameters, Pixel, Sample,
    SampleMesh, Shape, Specification, Tint, View,
    error::SpecificationError,
    reader::{Field, Reader},
    sample_mesh,
};
use toml::{
    Spanned,
    de::{DeInteger, DeValue},
};

/// What a view has where its table says nothing.
pub(super) const PLAIN_VIEW: View = View {
    camera_elevation_deg: 45.0,
    light_elevation_deg: 45.0,
    rotation_deg: 0.0,
    checker: false,
};

/// A struct whose fields are the keys of a table.
macro_rules! table_field {
    ($type:ident: $($field:ident),+) => {
        impl Field for $type {
            fn read(
                &mut self,
                value: &Spanned<DeValue<'_>>,
                key: &str,
                reader: &mut Reader<'_>,
            ) -> Result<(), SpecificationError> {
                let Some(table) = value.get_ref().as_table() else {
                    return Err(reader.wrong_type(key, "a table", value));
                };
                reader.read_table(
                    table,
                    key,
                    &mut [$((stringify!($field), &mut self.$field)),+],
                )
            }
        }
    };
}

table_field!(Image: width, height, pixel);
table_field!(Accuracy: absolute, relative);
table_field!(Integrator: kind, samples_per_pixel, max_bounces);
table_field!(Parameters: roughness, anisotropy, angle_deg, ior);
table_field!(Camera: distance_m, film_half_width);
table_field!(Light: distance_m, radius_m, power_w, efficacy_lm_per_w);
table_field!(Sample: shape, side_m, mesh);
table_field!(Checker: columns, rows, pitch_m, lower_edge_y_m, tilt_deg, patches_srgb8);
table_field!(View: camera_elevation_deg, light_elevation_deg, rotation_deg, checker);
table_field!(
    Specification: name, seed, materials, tint, image, accuracy, integrator, parameters, camera,
    light, sample, checker, views
);

/// An enum of a few names.
macro_rules! choice_field {
    ($type:ident, $expected:literal: $($name:literal => $variant:ident),+) => {
        impl $type {
            /// The names that a file may give.
            pub(super) const EXPECTED: &'static str = $expected;
        }

        impl Field for $type {
            fn read(
                &mut self,
                value: &Spanned<DeValue<'_>>,
                key: &str,
                reader: &mut Reader<'_>,
            ) -> Result<(), SpecificationError> {
                *self = match value.get_ref().as_str() {
                    $(Some($name) => Self::$variant,)+
                    _ => return Err(reader.wrong_type(key, Self::EXPECTED, value)),
                };
                Ok(())
            }
        }
    };
}

choice_field!(Tint, "\"hue\" or \"product\"": "hue" => Hue, "product" => Product);
choice_field!(Pixel, "\"half\" or \"float\"": "half" => Half, "float" => Float);
choice_field!(
    Shape, "\"square\", \"sphere\", \"cylinder\" or \"mesh\"":
    "square" => Square, "sphere" => Sphere, "cylinder" => Cylinder, "mesh" => Mesh
);
choice_field!(IntegratorKind, "\"hybrid\" or \"path\"": "hybrid" => Hybrid, "path" => Path);

/// Beyond every type of integer here, and every limit.
const INTEGER_TOO_LARGE: i128 = i128::MAX;

fn integer(number: &DeInteger<'_>) -> i128 {
    i128::from_str_radix(number.as_str(), number.radix()).unwrap_or(INTEGER_TOO_LARGE)
}

/// An unsigned integer. What the type cannot hold becomes its largest value, which no limit allows.
macro_rules! integer_field {
    ($($type:ty),+) => {$(
        impl Field for $type {
            fn read(
                &mut self,
                value: &Spanned<DeValue<'_>>,
                key: &str,
                reader: &mut Reader<'_>,
            ) -> Result<(), SpecificationError> {
                let Some(number) = value.get_ref().as_integer() else {
                    return Err(reader.wrong_type(key, "an integer", value));
                };
                *self = integer(number).try_into().unwrap_or(Self::MAX);
                Ok(())
            }
        }
    )+};
}

integer_field!(u32, u64);

impl Field for f64 {
    fn read(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: &str,
        reader: &mut Reader<'_>,
    ) -> Result<(), SpecificationError> {
        *self = match value.get_ref() {
            // NaN is refused later, like all that is out of range.
            DeValue::Float(number) => number.as_str().parse().unwrap_or(Self::NAN),
            DeValue::Integer(number) => integer(number) as Self,
            _ => return Err(reader.wrong_type(key, "a number", value)),
        };
        Ok(())
    }
}

impl Field for bool {
    fn read(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: &str,
        reader: &mut Reader<'_>,
    ) -> Result<(), SpecificationError> {
        let Some(truth) = value.get_ref().as_bool() else {
            return Err(reader.wrong_type(key, "true or false", value));
        };
        *self = truth;
        Ok(())
    }
}

impl Field for String {
    fn read(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: &str,
        reader: &mut Reader<'_>,
    ) -> Result<(), SpecificationError> {
        let Some(text) = value.get_ref().as_str() else {
            return Err(reader.wrong_type(key, "a text", value));
        };
        text.clone_into(self);
        Ok(())
    }
}

/// A mesh, by the name of a file in the specification's folder or by its digest.
impl Field for Option<SampleMesh> {
    fn read(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: &str,
        reader: &mut Reader<'_>,
    ) -> Result<(), SpecificationError> {
        let Some(name) = value.get_ref().as_str() else {
            return Err(reader.wrong_type(key, "a text", value));
        };
        let found = sample_mesh::load(name, reader.folder);
        *self = Some(found.map_err(|message| SpecificationError::Refused {
            place: reader.place(value.span().start),
            key: key.to_owned(),
            message,
        })?);
        Ok(())
    }
}

/// A range.
impl Field for [f64; 2] {
    fn read(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: &str,
        reader: &mut Reader<'_>,
    ) -> Result<(), SpecificationError> {
        let Some([low, high]) = elements(value) else {
            return Err(reader.wrong_type(key, "a list of two numbers, [low, high]", value));
        };
        reader.read_field(low, format!("{key}[0]"), &mut self[0])?;
        reader.read_field(high, format!("{key}[1]"), &mut self[1])
    }
}

/// A list of tables or colours, which replaces the preset's.
macro_rules! list_field {
    ($type:ty, $initial:expr, $expected:literal) => {
        impl Field for Vec<$type> {
            fn read(
                &mut self,
                value: &Spanned<DeValue<'_>>,
                key: &str,
                reader: &mut Reader<'_>,
            ) -> Result<(), SpecificationError> {
                let Some(values) = value.get_ref().as_array() else {
                    return Err(reader.wrong_type(key, $expected, value));
                };
                self.clear();
                for (place, value) in values.iter().enumerate() {
                    let mut element = $initial;
                    reader.read_field(value, format!("{key}[{place}]"), &mut element)?;
                    self.push(element);
                }
                Ok(())
            }
        }
    };
}

list_field!(View, PLAIN_VIEW, "a list of views");
list_field!([u8; 3], [0; 3], "a list of colours");

/// An 8-bit colour.
impl Field for [u8; 3] {
    fn read(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: &str,
        reader: &mut Reader<'_>,
    ) -> Result<(), SpecificationError> {
        const EXPECTED: &str = "a colour of three integers, [red, green, blue], 0 to 255 each";
        let Some(channels): Option<[_; 3]> = elements(value) else {
            return Err(reader.wrong_type(key, EXPECTED, value));
        };
        for (channel, value) in self.iter_mut().zip(channels) {
            let number = value.get_ref().as_integer().map(integer);
            *channel = number
                .and_then(|number| number.try_into().ok())
                .ok_or_else(|| reader.wrong_type(key, EXPECTED, value))?;
        }
        Ok(())
    }
}

/// The elements of a list that has as many as are wanted.
fn elements<'a, 'b, const N: usize>(
    value: &'a Spanned<DeValue<'b>>,
) -> Option<[&'a Spanned<DeValue<'b>>; N]> {
    let values: Vec<_> = value.get_ref().as_array()?.iter().collect();
    values.try_into().ok()
}
