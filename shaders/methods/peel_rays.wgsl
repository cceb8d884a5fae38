// Lens rays marched through the peels' height fields: GPU backend of src/methods/published/peel_rays/, whose module
// head gives the reasons.
//
// |follow   adds the rays of a batch of views to the sums
//
// A surface is formed by fragments of neighbouring samples that lie within JOIN_PX of one another.

// CoC range of the stack, and numbers of search steps.
struct March {
    nearest: f32,
    farthest: f32,
    linear_steps: u32,
    binary_steps: u32,
}

@group(0) @binding(9) var<uniform> march: March;

// From the program: JOIN_PX and STEPS_PER_SAMPLE.

// Indices of the N-buffers: the smallest CoC radius of a block, and its largest, negated.
const NEAREST: u32 = 0u;
const FARTHEST: u32 = 1u;

// State of the march of a ray.
struct Walk {
    // CoC range of the march, number of steps, and index of the current step.
    range: vec2f,
    steps: u32,
    step: u32,
    // Current segment: CoC radii at its ends, and starts of the sample lists there.
    ends: vec2f,
    lists: vec2u,
    // End of the segment (0 or 1) whose fragments are tested, and index of the next fragment.
    end_index: u32,
    next_index: u32,
    // Fragments up to this CoC radius were hit before.
    passed_coc_px: f32,
}

// A fragment, if found: start of its sample's list, its index, and its CoC radius.
struct Hit {
    found: bool,
    list: u32,
    index: u32,
    coc_px: f32,
}

// CoC range of the fragments between two sample positions; starts at ABSENT if there are none.
fn range_between(a: vec2f, b: vec2f) -> vec2f {
    let window = window_between(a, b);
    return vec2f(least_in(NEAREST, window), -least_in(FARTHEST, window));
}

// CoC range of the fragments that rays through the pixel with centre `centre` (in samples) can hit.
fn range_of_bundle(centre: vec2f) -> vec2f {
    var range = vec2f(march.nearest, march.farthest);
    // The fragments within reach of the full range give a smaller reach, and that a smaller range.
    for (var i = 0u; i < 2u && range.x < ABSENT; i++) {
        let reach = (max(abs(range.x), abs(range.y)) + 0.5) * stack.supersample;
        range = range_between(centre - reach, centre + reach);
    }
    return range;
}

// The next fragment of one list that can be hit in the segment of `walk`.
fn next_in_list(walk: Walk) -> Hit {
    let list = walk.lists[walk.end_index];
    for (var i = walk.next_index; i < list + stack.depth; i++) {
        let coc = coc_px[i];
        if coc >= walk.ends.x && coc > walk.passed_coc_px {
            return Hit(coc <= walk.ends.y, list, i, coc);
        }
    }
    return Hit(false, list, list, ABSENT);
}

fn is_opaque(index: u32) -> bool {
    return blue_alpha[index].y >= OPAQUE_ALPHA;
}

// The fragment of the list at `list` that continues the surface of `found`: `found` itself, or a joined fragment if
// both are opaque. Translucent ones would count twice. `is_found_opaque` tells whether `found` is opaque.
fn joined_fragment(list: u32, found: Hit, is_found_opaque: bool) -> Hit {
    if list == found.list {
        return found;
    }
    for (var i = list; is_found_opaque && i < list + stack.depth; i++) {
        let coc = coc_px[i];
        if abs(coc - found.coc_px) < JOIN_PX {
            return Hit(is_opaque(i), list, i, coc);
        }
        if coc > found.coc_px {
            break;
        }
    }
    return Hit(false, list, list, ABSENT);
}

// Binary search for the intersection of the ray with the surface of `candidate`, which lies at the tested end of the
// segment; not found if the surface ends before it.
//
// One end of the search stays over the surface. The other end is past the surface's edge, or over the surface but on
// its other side.
fn search(ray: Ray, walk: Walk, candidate: Hit) -> Hit {
    // Where the ray is in front of the surface, the surface has more CoC depth at the segment's first end, less at
    // its last.
    let side = select(-1.0, 1.0, walk.end_index == 0u);
    let is_found_opaque = is_opaque(candidate.index);
    var found = candidate;
    var on = walk.ends[walk.end_index];
    var off = walk.ends[1u - walk.end_index];
    var beyond = joined_fragment(walk.lists[1u - walk.end_index], found, is_found_opaque);
    beyond.found = beyond.found && side * beyond.coc_px <= side * off;
    for (var i = 0u; i < march.binary_steps; i++) {
        let middle = 0.5 * (on + off);
        let next = joined_fragment(list_at(ray_at(ray, middle)), found, is_found_opaque);
        if next.found && side * next.coc_px >= side * middle {
            on = middle;
            found = next;
        } else {
            off = middle;
            beyond = next;
        }
    }
    if !beyond.found {
        found.found = side * found.coc_px <= side * off;
        return found;
    }
    // The surface continues past the ray: take the sample where a straight line between the two sides crosses it.
    let before = abs(found.coc_px - on);
    let past = abs(beyond.coc_px - off);
    var share = 0.0;
    if before > 0.0 {
        share = before / (before + past);
    }
    let crossed = joined_fragment(list_at(ray_at(ray, on + (off - on) * share)), found, is_found_opaque);
    if crossed.found {
        return crossed;
    }
    return found;
}

// Start of the march of `ray` through the CoC radii of `range`.
fn first_walk(ray: Ray, range: vec2f) -> Walk {
    let passed = max(abs(ray.step.x), abs(ray.step.y)) * (range.y - range.x) * STEPS_PER_SAMPLE;
    let steps = clamp(u32(ceil(passed)), 1u, march.linear_steps);
    let list = list_at(ray_at(ray, range.x));
    // As if the last fragment of a segment of zero length had been tested.
    return Walk(range, steps, 0u, range.xx, vec2u(list), 1u, list + stack.depth, -ABSENT);
}

// Advances `walk` by one step.
fn take_step(ray: Ray, walk: ptr<function, Walk>) {
    let range = (*walk).range;
    (*walk).step++;
    let share = f32((*walk).step) / f32((*walk).steps);
    let to = select(range.y, range.x + (range.y - range.x) * share, (*walk).step < (*walk).steps);
    (*walk).ends = vec2f((*walk).ends.y, to);
    (*walk).lists = vec2u((*walk).lists.y, list_at(ray_at(ray, to)));
}

// Starts testing the fragments at one end of the segment of `walk`.
fn test_end(walk: ptr<function, Walk>, end_index: u32) {
    (*walk).end_index = end_index;
    (*walk).next_index = (*walk).lists[end_index];
}

// The next fragment that `ray` may hit on its `walk`; not found when the walk has ended.
fn next_candidate(ray: Ray, walk: ptr<function, Walk>) -> Hit {
    loop {
        let candidate = next_in_list(*walk);
        if candidate.found {
            return candidate;
        }
        if (*walk).end_index == 0u && (*walk).lists.x != (*walk).lists.y {
            test_end(walk, 1u);
        } else if (*walk).step < (*walk).steps {
            take_step(ray, walk);
            test_end(walk, 0u);
        } else {
            return candidate;
        }
    }
    return Hit(false, 0u, 0u, ABSENT);
}

// Marches `ray` through the fragments in the CoC radii of `bundle`.
fn follow_ray(ray: Ray, bundle: vec2f) -> Sum {
    var color_sum = vec3f(0.0);
    var transmittance = 1.0;
    var range = bundle;
    if bundle.x < ABSENT {
        range = range_between(ray_at(ray, bundle.x), ray_at(ray, bundle.y));
    }
    // The ray may pass over fragments outside of the bundle's range, which it cannot hit.
    range = vec2f(max(range.x, bundle.x), min(range.y, bundle.y));
    if range.x > range.y {
        return ended(ray, color_sum, 1.0);
    }
    var walk = first_walk(ray, range);
    // Steps have a loop of their own: this minimizes the time for which threads that search wait for threads that
    // step.
    loop {
        let candidate = next_candidate(ray, &walk);
        if !candidate.found {
            break;
        }
        var hit = candidate;
        if walk.lists.x != walk.lists.y {
            hit = search(ray, walk, candidate);
        }
        if hit.found {
            let shown = color_of(hit.index);
            color_sum += transmittance * shown.rgb;
            transmittance *= let_through(shown.a);
            if transmittance <= 0.0 {
                break;
            }
            walk.passed_coc_px = hit.coc_px;
            test_end(&walk, 0u);
        } else if walk.end_index == 0u {
            test_end(&walk, 1u);
        } else {
            walk.next_index = candidate.index + 1u;
        }
    }
    return ended(ray, color_sum, transmittance);
}

@compute @workgroup_size(8, 8)
fn follow(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= stack.width || at.y >= stack.rows {
        return;
    }
    let centre = centre_of(vec2u(at.x, stack.row + at.y));
    let bundle = range_of_bundle(centre);
    var sum = NO_RAYS;
    for (var view = batch.first_view; view < batch.end_view; view++) {
        sum = added(sum, follow_ray(ray_of(view, centre), bundle));
    }
    add_batch(at.y * stack.width + at.x, sum);
}
