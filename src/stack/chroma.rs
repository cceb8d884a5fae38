//! Pictures of luminance and chroma: `Y`, `RY = (R − Y) / Y` and `BY = (B − Y) / Y`, by the primaries of the header.

use crate::image::Plane;
use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, Chromaticities, Text};

/// The luminance of red, green and blue of Rec. 709, which a header without chromaticities means.
const REC_709: [f32; 3] = [0.212_639, 0.715_169, 0.072_192];

/// The luminance of red, green and blue, whose sum is 1; `None` for primaries that cannot be.
pub(super) fn luminance(attributes: &[(Text, AttributeValue)]) -> Option<[f32; 3]> {
    let stated = attributes.iter().find_map(|(_, value)| match value {
        AttributeValue::Chromaticities(primaries) => Some(primaries),
        _ => None,
    });
    let weights = stated.map_or(Some(REC_709), of_primaries)?;
    weights.iter().all(|weight| weight.is_finite() && *weight > 0.0).then_some(weights)
}

/// The luminance of the primaries: the shares that add up to the white point.
fn of_primaries(Chromaticities { red, green, blue, white }: &Chromaticities) -> Option<[f32; 3]> {
    // Tristimulus values of luminance 1: (x / y, 1, (1 − x − y) / y).
    let tristimulus = |Vec2(x, y): Vec2<f32>| {
        let (x, y) = (f64::from(x), f64::from(y));
        [x / y, 1.0, (1.0 - x - y) / y]
    };
    let [r, g, b, w] = [*red, *green, *blue, *white].map(tristimulus);
    let determinant = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1]) - b[0] * (a[1] * c[2] - a[2] * c[1])
            + c[0] * (a[1] * b[2] - a[2] * b[1])
    };
    let whole = determinant(r, g, b);
    let shares =
        [determinant(w, g, b), determinant(r, w, b), determinant(r, g, w)].map(|part| (part / whole) as f32);
    (whole != 0.0).then_some(shares)
}

/// Turns chroma of red, luminance and chroma of blue into red, green and blue, in place.
pub(super) fn to_rgb(planes: &mut [Plane; 3], [of_red, of_green, of_blue]: [f32; 3]) {
    let [red, green, blue] = planes;
    for ((red, green), blue) in red.values_mut().iter_mut().zip(green.values_mut()).zip(blue.values_mut()) {
        let luminance = *green;
        *red = (*red + 1.0) * luminance;
        *blue = (*blue + 1.0) * luminance;
        *green = (luminance - of_red * *red - of_blue * *blue) / of_green;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_primaries_of_rec_709_have_their_luminances() {
        let primaries = Chromaticities {
            red: Vec2(0.64, 0.33),
            green: Vec2(0.3, 0.6),
            blue: Vec2(0.15, 0.06),
            white: Vec2(0.3127, 0.329),
        };
        let found = of_primaries(&primaries).expect("they are independent");
        assert!(found.iter().zip(REC_709).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?}");
    }
}
