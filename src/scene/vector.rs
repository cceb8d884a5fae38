//! Neighbouring pixels at once: arithmetic on vectors of one number a pixel, with the instructions that the machine has.
//!
//! Each operation is done pixel by pixel and in the order in which it is written, so that every instruction set gives the same bits.

use pulp::Simd;
use std::ops::{Add, BitAnd, Div, Mul, Sub};

/// A number for each of [`Simd::F32_LANES`] pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vector<S: Simd> {
    simd: S,
    values: S::f32s,
}

/// For each pixel, whether something holds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Holds<S: Simd> {
    simd: S,
    mask: S::m32s,
}

impl<S: Simd> Vector<S> {
    /// The same for all pixels.
    #[inline(always)]
    pub(super) fn all(simd: S, value: f32) -> Self {
        Self { simd, values: simd.splat_f32s(value) }
    }

    /// The first of `values`.
    #[inline(always)]
    pub(super) fn load(simd: S, values: &[f32]) -> Self {
        Self { simd, values: S::as_simd_f32s(&values[..S::F32_LANES]).0[0] }
    }

    /// Writes the numbers to the first of `values`.
    #[inline(always)]
    pub(super) fn store(self, values: &mut [f32]) {
        S::as_mut_simd_f32s(&mut values[..S::F32_LANES]).0[0] = self.values;
    }

    #[inline(always)]
    pub(super) fn abs(self) -> Self {
        Self { values: self.simd.abs_f32s(self.values), ..self }
    }

    /// The smaller of two numbers; `other` if one is none.
    #[inline(always)]
    pub(super) fn smaller(self, other: Self) -> Self {
        self.is_below(other).select(self, other)
    }

    /// The larger of two numbers; `other` if one is none.
    #[inline(always)]
    pub(super) fn larger(self, other: Self) -> Self {
        self.is_above(other).select(self, other)
    }

    /// The number, or the nearer of 0 and 1 if it is not between them.
    #[inline(always)]
    pub(super) fn clamped(self) -> Self {
        let [zero, one] = [0.0, 1.0].map(|value| Self::all(self.simd, value));
        self.larger(zero).smaller(one)
    }

    #[inline(always)]
    pub(super) fn is_above(self, other: Self) -> Holds<S> {
        Holds { simd: self.simd, mask: self.simd.greater_than_f32s(self.values, other.values) }
    }

    #[inline(always)]
    pub(super) fn is_below(self, other: Self) -> Holds<S> {
        Holds { simd: self.simd, mask: self.simd.less_than_f32s(self.values, other.values) }
    }

    #[inline(always)]
    pub(super) fn is_at_most(self, other: Self) -> Holds<S> {
        Holds { simd: self.simd, mask: self.simd.less_than_or_equal_f32s(self.values, other.values) }
    }

    /// The smallest of the numbers of all pixels.
    #[inline(always)]
    pub(super) fn least(self) -> f32 {
        self.simd.reduce_min_f32s(self.values)
    }

    /// The largest of the numbers of all pixels.
    #[inline(always)]
    pub(super) fn most(self) -> f32 {
        self.simd.reduce_max_f32s(self.values)
    }
}

impl<S: Simd> Holds<S> {
    /// Of each pixel, the number of `yes` where it holds, otherwise that of `no`.
    #[inline(always)]
    pub(super) fn select(self, yes: Vector<S>, no: Vector<S>) -> Vector<S> {
        Vector { values: self.simd.select_f32s(self.mask, yes.values, no.values), ..no }
    }

    /// Whether it holds for any pixel.
    #[inline(always)]
    pub(super) fn any(self) -> bool {
        self.simd.first_true_m32s(self.mask) < S::F32_LANES
    }
}

impl<S: Simd> BitAnd for Holds<S> {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self { mask: self.simd.and_m32s(self.mask, other.mask), ..self }
    }
}

impl<S: Simd> Add for Vector<S> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { values: self.simd.add_f32s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Sub for Vector<S> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { values: self.simd.sub_f32s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Mul for Vector<S> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self { values: self.simd.mul_f32s(self.values, other.values), ..self }
    }
}

impl<S: Simd> Div for Vector<S> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self { values: self.simd.div_f32s(self.values, other.values), ..self }
    }
}
