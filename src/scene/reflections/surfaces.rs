//! Which fragments are of one surface, so that what one shows can be seen at the place of the other.
//!
//! Neighbours are of one surface where its normals turn little and the line between them lies in it. Parts of one plane are one mirror,
//! whatever stands between them.

use super::view::Point;
use glam::Vec3;

/// No surface.
pub(super) const NONE: u32 = 0;

/// Cosine of the largest angle between the normals of neighbours.
const LEAST_COSINE: f32 = 0.9;

/// Largest share of the line between neighbours that is along their normals.
const STEEPNESS: f32 = 0.25;

/// Rounding of depth that is stored as half floats, as a share of it.
const DEPTH_ROUNDING: f32 = 1e-3;

/// Cosine of the largest angle between two parts of one plane, and the largest distance between them as a share of their depth.
const PLANE: [f32; 2] = [0.9999, 2e-3];

/// Largest number of flat surfaces that are compared with one another.
const MOST_MIRRORS: usize = 512;

/// A disjoint set of fragments: each has the number of another fragment of its surface, or its own.
#[derive(Debug)]
pub(super) struct Surfaces {
    parents: Vec<u32>,
}

impl Surfaces {
    /// Each of `count` fragments on a surface of its own.
    pub(super) fn apart(count: usize) -> Self {
        Self { parents: (0..count as u32).collect() }
    }

    fn root(&mut self, mut fragment: u32) -> u32 {
        while self.parents[fragment as usize] != fragment {
            let next = self.parents[self.parents[fragment as usize] as usize];
            self.parents[fragment as usize] = next;
            fragment = next;
        }
        fragment
    }

    /// Joins the surfaces of two fragments.
    pub(super) fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.root(one as u32), self.root(other as u32));
        // The smaller number stays, so that the order of joining does not matter.
        let (kept, joined) = if one < other { (one, other) } else { (other, one) };
        self.parents[joined as usize] = kept;
    }

    /// The surface of each fragment, from 1 on, and their number; [`NONE`] for those that are not `present`.
    pub(super) fn numbered(mut self, present: impl Fn(usize) -> bool) -> (Vec<u32>, usize) {
        let mut count = 0;
        let mut numbers = vec![NONE; self.parents.len()];
        for fragment in (0..self.parents.len()).filter(|&fragment| present(fragment)) {
            let root = self.root(fragment as u32) as usize;
            if numbers[root] == NONE {
                count += 1;
                numbers[root] = count as u32;
            }
            numbers[fragment] = numbers[root];
        }
        (numbers, count)
    }
}

/// Whether two neighbours are of one surface.
pub(super) fn joins(one: &Point, other: &Point) -> bool {
    let step = other.at - one.at;
    let off = step.dot(one.normal + other.normal).abs() * 0.5;
    one.normal.dot(other.normal) > LEAST_COSINE
        && off < STEEPNESS * step.length() + DEPTH_ROUNDING * one.at.z.abs()
}

/// What is known of a surface: sums over its fragments.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Plane {
    fragments: f32,
    /// How many of them reflect as a flat mirror does.
    flat: f32,
    normal: Vec3,
    at: Vec3,
}

impl Plane {
    /// Adds a fragment, which is `flat` from 0 to 1.
    pub(super) fn add(&mut self, point: &Point, flat: f32) {
        self.fragments += 1.0;
        self.flat += flat;
        self.normal += point.normal;
        self.at += point.at;
    }

    fn is_flat(&self) -> bool {
        self.flat > 0.5 * self.fragments
    }

    fn contains(&self, other: &Self) -> bool {
        let [normal, other_normal] = [self.normal, other.normal].map(Vec3::normalize_or_zero);
        let [at, other_at] = [self, other].map(|plane| plane.at / plane.fragments);
        normal.dot(other_normal) > PLANE[0]
            && (other_at - at).dot(normal).abs() < PLANE[1] * other_at.length()
    }
}

/// For each of `planes` the number of the first one that it is a part of.
pub(super) fn same_planes(planes: &[Plane]) -> Vec<u32> {
    let mut firsts: Vec<usize> = Vec::new();
    let number = |(own, plane): (usize, &Plane)| {
        if !plane.is_flat() {
            return own as u32;
        }
        let found = firsts.iter().copied().find(|&first| planes[first].contains(plane));
        if found.is_none() && firsts.len() < MOST_MIRRORS {
            firsts.push(own);
        }
        found.unwrap_or(own) as u32
    };
    planes.iter().enumerate().map(number).collect()
}
