//! What each method has to do, counted: the terms that a prediction sums up.
//!
//! A term is an amount of work of one kind, such as pixels × views; what one unit of it takes stands beside its name in
//! [`super::table`]. Amounts follow from the heads of the methods' own modules, where their cost is stated.

use super::shape::Shape;
use crate::scene::{EffectKind, Facts, Plan};

/// Amounts of work, in the order of the method's terms in [`super::table`].
pub(super) type Work = fn(&Shape<'_>) -> Vec<f64>;

/// From this number of views on `shear` cuts depth into slices half as wide.
const SHEAR_MANY_VIEWS: usize = 128;

/// `recursive-gaussian` makes no more layers on a side.
const MOST_DEPTH_LAYERS: u32 = 512;

/// Mean of `|x| + |y|` over a disc of radius 1: the samples' sides that a ray crosses for each unit of CoC radius.
const SIDES_CROSSED: f64 = 8.0 / (3.0 * std::f64::consts::PI);

/// A picture without a lens.
pub(super) fn pinhole(shape: &Shape<'_>) -> Vec<f64> {
    vec![shape.pixels() * shape.supersample().powi(2)]
}

pub(super) fn shear(shape: &Shape<'_>) -> Vec<f64> {
    let &Shape { facts, plan, .. } = shape;
    let views = shape.views();
    let many = plan.views.is_some_and(|views| views >= SHEAR_MANY_VIEWS);
    let width_px = if many { 0.25 } else { 0.5 };
    let [edges, changes] = [facts.spread.edges, facts.spread.changes].map(|sums| sums.iter().sum::<f64>());
    // Half as wide slices cut slopes twice as often, and edges as often as before.
    let runs = (edges + (changes - edges) * 0.5 / width_px) / shape.supersample() + shape.size()[1];
    let translucent = facts.translucent_fragments as f64 / shape.supersample().powi(2);
    let discs = shape.highlights();
    let fill = if plan.does(EffectKind::Fill) { shape.pixels() } else { 0.0 };
    vec![
        shape.pixels() * shape.layers(),
        shape.merged(),
        fill,
        shape.pixels() * views,
        translucent * views,
        shape.row_slices(width_px) * views,
        runs * views,
        discs.count,
        discs.rows,
    ]
}

pub(super) fn accumulate(shape: &Shape<'_>) -> Vec<f64> {
    let rays = shape.pixels() * shape.views();
    let cells = rays * shape.supersample() * SIDES_CROSSED * shape.depths().whole_px;
    vec![shape.samples(), rays, rays * shape.layers(), cells, cells * shape.layers()]
}

pub(super) fn recursive_gaussian(shape: &Shape<'_>) -> Vec<f64> {
    let parameters = &shape.plan.parameters.recursive_gaussian;
    // Layer n is blurred by σ_n² = n (n + 1) (2n + 1) / 6, and lies where the CoC diameter is so many σ_n.
    let boundary_px = |n: u32| {
        let n = f64::from(n);
        0.5 * f64::from(parameters.coc_per_sigma) * (n * (n + 1.0) * (2.0 * n + 1.0) / 6.0).sqrt()
    };
    let enough =
        |reach: f64| (0..MOST_DEPTH_LAYERS).find(|&n| boundary_px(n) >= reach).unwrap_or(MOST_DEPTH_LAYERS);
    let [front, back] = shape.reach_px().map(enough);
    let needed = f64::from(1 + front + back);
    // Layers past the last fragment are not blurred.
    let blurred = parameters.layers.map_or(needed, |layers| needed.min(layers as f64));
    let spans = (0..=back).map(|n| [boundary_px(n.saturating_sub(1)), boundary_px(n + 1)]);
    let front_spans = (1..=front).map(|n| [-boundary_px(n + 1), -boundary_px(n - 1)]);
    let matted: f64 = spans.chain(front_spans).map(|span| shape.rows_with(span)).sum();
    let matted = matted * shape.size()[0] * blurred / needed;
    vec![shape.pixels() * shape.layers(), shape.merged(), shape.pixels() * blurred, matted * shape.layers()]
}

pub(super) fn b_buffer(shape: &Shape<'_>) -> Vec<f64> {
    // Level n has the variance (4ⁿ − 1) / 2, a disc c² / 4.
    let levels: f64 = shape.reach_px().map(|coc| (1.0 + 0.5 * coc * coc).log(4.0).ceil()).iter().sum();
    let pixels = shape.pixels();
    vec![pixels, pixels * shape.layers(), shape.merged(), pixels * levels, pixels * shape.layers() * levels]
}

pub(super) fn point_splat(shape: &Shape<'_>) -> Vec<f64> {
    let parameters = &shape.plan.parameters.point_splat;
    let edges = shape.edge_density();
    // Where something else is within a CoC of the pixel nothing is reduced.
    let near_edge = |coc_px: f64| 1.0 - (-edges * 2.0 * coc_px).exp();
    let points = |coc_px: f64| match parameters.accelerated && coc_px >= 2.0 {
        true => near_edge(coc_px) + 0.25 * (1.0 - near_edge(coc_px)),
        false => 1.0,
    };
    let area = |coc_px: f64| shape.disc_px(coc_px.max(0.5));
    let visible = shape.sums(|coc| points(coc) * area(coc))[0];
    let rows = shape.sums(|coc| points(coc) * shape.disc_rows(coc))[0];
    let hides = parameters.hidden && shape.facts.layers > 1;
    let hidden = if hides { shape.pixels() } else { 0.0 };
    vec![shape.pixels(), shape.merged(), hidden, visible, rows]
}

pub(super) fn layer_rays(shape: &Shape<'_>) -> Vec<f64> {
    let parameters = &shape.plan.parameters.layer_rays;
    let rays = shape.pixels() * shape.views();
    let span: f64 = shape.reach_px().iter().sum();
    // Layers share what tells whether they are in reach.
    let slabs = (1.0 + span / f64::from(parameters.delta_px)).min(64.0);
    let bundles = shape.pixels() * slabs;
    let cones = if parameters.cones { 1.0 } else { 0.0 };
    vec![
        shape.samples(),
        shape.samples() * cones,
        bundles,
        rays,
        rays * cones,
        rays * parameters.iterations as f64,
    ]
}

/// Pixels of all sub-images of a picture, and of the finest levels of their pyramids.
fn sub_images(shape: &Shape<'_>, first_radius_px: f32) -> [f64; 2] {
    let first = f64::from(first_radius_px);
    let most = shape.size()[0].max(shape.size()[1]).max(1.0).log2().ceil() as i32 + 1;
    let enough =
        |reach: f64| if reach <= 0.0 { 0 } else { ((reach / first).log2().ceil() as i32 + 1).max(1) };
    let [near, far] = shape.reach_px().map(|reach| enough(reach).min(most));
    let infinity = f64::from(shape.facts.spread.coc_infinity_px);
    let possible = (1..=most).take_while(|&i| first * f64::from(i - 1).exp2() < infinity).count() as i32;
    // A pyramid of n levels has sides that are multiples of 2ⁿ, and a border.
    let padded = |levels: i32| {
        let multiple = f64::from(levels).exp2();
        shape.size().map(|side| ((side + 2.0) / multiple).ceil() * multiple).iter().product::<f64>()
    };
    let far = far.min(possible);
    let blurred: f64 = (1..=near).chain(1..=far).map(padded).sum();
    [shape.pixels() * f64::from(1 + near + far), blurred]
}

pub(super) fn opaque_blur(shape: &Shape<'_>) -> Vec<f64> {
    let [laid, _] = sub_images(shape, shape.plan.parameters.opaque_blur.first_radius_px);
    vec![shape.pixels(), shape.pixels() * shape.layers(), shape.merged(), laid]
}

pub(super) fn pyramid_disocclusion(shape: &Shape<'_>) -> Vec<f64> {
    let [_, blurred] = sub_images(shape, shape.plan.parameters.pyramid_disocclusion.first_radius_px);
    vec![shape.pixels(), shape.pixels() * shape.layers(), shape.merged(), blurred]
}

pub(super) fn peel_rays(shape: &Shape<'_>) -> Vec<f64> {
    let parameters = &shape.plan.parameters.peel_rays;
    let rays = shape.pixels() * shape.views();
    // Two steps for each sample that is passed along the longer of the two axes.
    let steps = 2.0 * 0.77 * shape.supersample() * shape.depths().before_px;
    let steps = steps.min(parameters.linear_steps as f64);
    vec![
        shape.samples(),
        shape.pixels(),
        rays,
        rays * (parameters.binary_steps as f64).min(steps),
        rays * steps,
    ]
}

pub(super) fn gather(shape: &Shape<'_>) -> Vec<f64> {
    let most = shape.views();
    let visited = |reach: f64| {
        let disc = std::f64::consts::PI * (reach + 0.5).powi(2);
        if reach <= 0.5 { 0.0 } else { disc.min(most) }
    };
    // Eight levels of radius an octave, four a step, each a pass over the picture.
    let steps = shape.facts.spread.steps.iter().skip(1);
    let levels = 4.0 * steps.filter(|step| step.front[0] > 0).count() as f64;
    let pixels = shape.pixels();
    vec![pixels, pixels * shape.layers(), shape.merged(), pixels * levels, shape.reached(visited)]
}

pub(super) fn scatter(shape: &Shape<'_>) -> Vec<f64> {
    let pixels = shape.pixels();
    let rows = shape.sums(|coc| shape.disc_rows(coc))[0];
    let front = shape.sums(|_| 1.0)[0].max(1.0);
    // Slices are an eighth of a pixel wide near focus, where changes are counted by half pixels.
    let finer = shape.sums(|coc| (coc / 32.0).max(0.5) / (coc / 32.0).max(0.125))[0] / front;
    let [changes, edges] = [shape.facts.spread.changes[0], shape.facts.spread.edges[0]];
    let runs = (edges + (changes - edges) * finer) / shape.supersample() + shape.size()[1];
    let slices = shape.slices(0.125);
    vec![pixels, pixels * shape.layers(), shape.merged(), rows, runs / front * rows, pixels * slices]
}

/// What carrying out `plan` on a scene that shows `facts` consists of, term by term, with the terms' names; see
/// [`super::table`].
pub fn work(facts: &Facts, plan: &Plan) -> Vec<(&'static str, f64)> {
    let shape = Shape { facts, plan };
    let cost = super::table::cost_of(plan);
    cost.terms.iter().map(|term| term.name).zip((cost.work)(&shape)).collect()
}
