// Lens rays marched through the peels' height fields: twin of src/methods/peel_rays/, whose module head has the reasons.
//
// follow   the rays of a go of views, added to the sums
//
// A surface is what fragments of neighbouring samples make that lie within JOIN_PX of one another.

// Between which CoC radii anything lies, and in how many steps it is searched for.
struct March {
    nearest: f32,
    farthest: f32,
    linear_steps: u32,
    binary_steps: u32,
}

@group(0) @binding(9) var<uniform> whole: March;

// The program's are JOIN_PX and STEPS_PER_SAMPLE.

// The N-buffers: the nearest CoC radius of a block, and its farthest, negated.
const NEAREST: u32 = 0u;
const FARTHEST: u32 = 1u;

// How far a ray has been marched.
struct Walk {
    // Between which CoC radii it goes, in how many steps, and the last one that has begun.
    range: vec2f,
    steps: u32,
    step: u32,
    // Its stretch: CoC radii at the ends, and where the lists of the samples there begin.
    ends: vec2f,
    lists: vec2u,
    // Of which end fragments are looked at, and from which place on.
    over: u32,
    place: u32,
    // Up to which CoC radius fragments have been met before.
    behind: f32,
}

// A fragment: where its sample's list begins, its own place, and its CoC radius; or none.
struct Hit {
    found: bool,
    list: u32,
    index: u32,
    coc_px: f32,
}

// CoC radii of all that lies between two sample positions; the first is ABSENT where nothing does.
fn range_between(a: vec2f, b: vec2f) -> vec2f {
    let window = window_between(a, b);
    return vec2f(least_in(NEAREST, window), -least_in(FARTHEST, window));
}

// CoC radii of all that the rays of the pixel whose centre is at sample position `centre` can meet.
fn range_of_bundle(centre: vec2f) -> vec2f {
    var range = vec2f(whole.nearest, whole.farthest);
    // What lies within reach of the whole range narrows the reach, and so the range, once more.
    for (var i = 0u; i < 2u && range.x < ABSENT; i++) {
        let reach = (max(abs(range.x), abs(range.y)) + 0.5) * stack.supersample;
        range = range_between(centre - reach, centre + reach);
    }
    return range;
}

// The first fragment that can be met in the stretch of `walk`, of those that are still to be looked at in one list.
fn next_in_list(walk: Walk) -> Hit {
    let list = walk.lists[walk.over];
    for (var i = walk.place; i < list + stack.depth; i++) {
        let coc = coc_px[i];
        if coc >= walk.ends.x && coc > walk.behind {
            return Hit(coc <= walk.ends.y, list, i, coc);
        }
    }
    return Hit(false, list, list, ABSENT);
}

fn is_opaque(index: u32) -> bool {
    return blue_alpha[index].y >= OPAQUE_ALPHA;
}

// The fragment of the list that begins at `list` that goes on with the surface of `found`: itself, or one near enough if both are opaque,
// as thin ones would count twice; `may` tells whether `found` is.
fn joined(list: u32, found: Hit, may: bool) -> Hit {
    if list == found.list {
        return found;
    }
    for (var i = list; may && i < list + stack.depth; i++) {
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

// Binary search for the place where the ray meets the surface of `candidate`, over which it is at the end of the stretch that is looked
// at; none if the surface ends before that.
//
// One end of the search stays over the surface. The other is beyond its edge, or over it too but on its other side.
fn search(ray: Ray, walk: Walk, candidate: Hit) -> Hit {
    // What is ahead of the ray over the surface has more CoC depth at the stretch's first end, less at its last.
    let ahead = select(-1.0, 1.0, walk.over == 0u);
    let may = is_opaque(candidate.index);
    var found = candidate;
    var on = walk.ends[walk.over];
    var off = walk.ends[1u - walk.over];
    var beyond = joined(walk.lists[1u - walk.over], found, may);
    beyond.found = beyond.found && ahead * beyond.coc_px <= ahead * off;
    for (var i = 0u; i < whole.binary_steps; i++) {
        let middle = 0.5 * (on + off);
        let next = joined(list_at(ray_at(ray, middle)), found, may);
        if next.found && ahead * next.coc_px >= ahead * middle {
            on = middle;
            found = next;
        } else {
            off = middle;
            beyond = next;
        }
    }
    if !beyond.found {
        found.found = ahead * found.coc_px <= ahead * off;
        return found;
    }
    // The surface goes on past the ray: the sample where a straight line between the two sides crosses it.
    let before = abs(found.coc_px - on);
    let past = abs(beyond.coc_px - off);
    var share = 0.0;
    if before > 0.0 {
        share = before / (before + past);
    }
    let crossed = joined(list_at(ray_at(ray, on + (off - on) * share)), found, may);
    if crossed.found {
        return crossed;
    }
    return found;
}

// Where the march of `ray` between the CoC radii of `range` begins.
fn walk_of(ray: Ray, range: vec2f) -> Walk {
    let passed = max(abs(ray.step.x), abs(ray.step.y)) * (range.y - range.x) * STEPS_PER_SAMPLE;
    let steps = clamp(u32(ceil(passed)), 1u, whole.linear_steps);
    let list = list_at(ray_at(ray, range.x));
    // As if the last fragment of a stretch without length had been looked at.
    return Walk(range, steps, 0u, range.xx, vec2u(list), 1u, list + stack.depth, -ABSENT);
}

// Takes the next step of `walk`.
fn take_step(ray: Ray, walk: ptr<function, Walk>) {
    let range = (*walk).range;
    (*walk).step++;
    let share = f32((*walk).step) / f32((*walk).steps);
    let to = select(range.y, range.x + (range.y - range.x) * share, (*walk).step < (*walk).steps);
    (*walk).ends = vec2f((*walk).ends.y, to);
    (*walk).lists = vec2u((*walk).lists.y, list_at(ray_at(ray, to)));
}

// Turns to the fragments of one end of the stretch of `walk`.
fn look_over(walk: ptr<function, Walk>, over: u32) {
    (*walk).over = over;
    (*walk).place = (*walk).lists[over];
}

// The next fragment that `ray` may meet on its `walk`; none when the walk is over.
fn next_candidate(ray: Ray, walk: ptr<function, Walk>) -> Hit {
    loop {
        let candidate = next_in_list(*walk);
        if candidate.found {
            return candidate;
        }
        if (*walk).over == 0u && (*walk).lists.x != (*walk).lists.y {
            look_over(walk, 1u);
        } else if (*walk).step < (*walk).steps {
            take_step(ray, walk);
            look_over(walk, 0u);
        } else {
            return candidate;
        }
    }
    return Hit(false, 0u, 0u, ABSENT);
}

// Marches `ray` through all that there is between the CoC radii of `bundle`.
fn follow_ray(ray: Ray, bundle: vec2f) -> Sum {
    var color = vec3f(0.0);
    var transmitted = 1.0;
    var range = bundle;
    if bundle.x < ABSENT {
        range = range_between(ray_at(ray, bundle.x), ray_at(ray, bundle.y));
    }
    // What the ray passes over may lie beyond the bundle's range, where it does not go.
    range = vec2f(max(range.x, bundle.x), min(range.y, bundle.y));
    if range.x > range.y {
        return Sum(color, 0.0, 1.0);
    }
    var walk = walk_of(ray, range);
    // Steps in a loop of their own: threads that search wait least for those that have nothing to search for.
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
            color += transmitted * shown.rgb;
            transmitted *= let_through(shown.a);
            if transmitted <= 0.0 {
                break;
            }
            walk.behind = hit.coc_px;
            look_over(&walk, 0u);
        } else if walk.over == 0u {
            look_over(&walk, 1u);
        } else {
            walk.place = candidate.index + 1u;
        }
    }
    return Sum(color, 1.0 - transmitted, 1.0);
}

@compute @workgroup_size(8, 8)
fn follow(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= stack.width || at.y >= stack.rows {
        return;
    }
    let centre = centre_of(vec2u(at.x, stack.row + at.y));
    let bundle = range_of_bundle(centre);
    var sum = Sum(vec3f(0.0), 0.0, 0.0);
    for (var view = batch.first_view; view < batch.end_view; view++) {
        let part = follow_ray(ray_of(view, centre), bundle);
        sum = Sum(sum.color + part.color, sum.hit + part.hit, sum.rays + part.rays);
    }
    add_batch(at.y * stack.width + at.x, sum);
}
