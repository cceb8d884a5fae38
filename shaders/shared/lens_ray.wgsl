// A lens ray through the samples of a stack. CPU version: src/methods/shared/lens_ray.rs.

// Larger than any CoC depth of a fragment or a ray.
const BEYOND: f32 = 3e38;

// A ray: at CoC depth c it is at sample position `start + c·step`.
struct LensRay {
    start: vec2f,
    step: vec2f,
    inverse: vec2f,
    // BEYOND along an axis that the ray is perpendicular to, so that it never leaves a sample there; 0 on other axes.
    perpendicular_exit: vec2f,
    // Direction on each axis: -1 or 1.
    heading: vec2i,
}

// Where a ray leaves a square of samples: CoC depth and direction.
struct Exit {
    coc: f32,
    side: vec2i,
}

// The ray that starts at `start` and moves by `step`, in samples; `inverse` is the reciprocal of the step, 0 along an axis that the ray is
// perpendicular to.
fn lens_ray(start: vec2f, step: vec2f, inverse: vec2f) -> LensRay {
    let perpendicular_exit = select(vec2f(0.0), vec2f(BEYOND), inverse == vec2f(0.0));
    let heading = select(vec2i(-1), vec2i(1), step > vec2f(0.0));
    return LensRay(start, step, inverse, perpendicular_exit, heading);
}

// The sample at CoC depth `coc`.
fn cell_at(ray: LensRay, coc: f32) -> vec2i {
    return vec2i(floor(ray.start + coc * ray.step));
}

// Where `ray` leaves the square of `side` samples that begins at `first`.
fn leaves(ray: LensRay, first: vec2i, side: i32) -> Exit {
    let edge = first + side * max(ray.heading, vec2i(0));
    let leave = (vec2f(edge) - ray.start) * ray.inverse + ray.perpendicular_exit;
    if leave.x <= leave.y {
        return Exit(leave.x, vec2i(ray.heading.x, 0));
    }
    return Exit(leave.y, vec2i(0, ray.heading.y));
}
