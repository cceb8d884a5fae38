// What a lens ray sees in a surface that reflects. CPU version: src/methods/shared/reflected_light.rs, whose module head explains it.
// lens_ray.wgsl comes before it.

// The samples of the whole stack.
struct Reflecting {
    columns: i32,
    rows: i32,
    layers: u32,
    // Samples per pixel along each axis.
    supersample: f32,
}

@group(0) @binding(20) var<uniform> reflecting: Reflecting;
// [layer][row][column]: one more than the number of the fragment in `reflecting_fragments`; 0 where nothing reflects.
@group(0) @binding(21) var<storage, read> reflecting_at: array<u32>;
// [fragment], four vectors each: red, green, blue, CoC radius; the matrix of its movement; nearest and farthest CoC radius of what it shows
// as a flat mirror, shares that move as in a flat mirror and as on a curved surface; the largest CoC radius of what its surface shows as a
// flat mirror, and the bits of the surface's number.
@group(0) @binding(22) var<storage, read> reflecting_fragments: array<vec4f>;

// Whether any reflection moves. The program defines REFLECTION_STEPS and REFLECTION_JOIN_PX.
override REFLECTS = true;

// A fragment that reflects: its layer, and what `reflecting_at` has.
struct Met {
    layer: u32,
    fragment: u32,
}

// What changes for a ray in the light that a fragment reflects, not multiplied by alpha, and the share of it that moves.
struct MovedLight {
    own: vec3f,
    seen: vec3f,
    share: f32,
}

const NOTHING_MOVES = MovedLight(vec3f(0.0), vec3f(0.0), 0.0);

fn in_frame(at: vec2i) -> vec2i {
    return clamp(at, vec2i(0), vec2i(reflecting.columns, reflecting.rows) - 1);
}

// What `reflecting_at` has of `layer` at the sample `at`, which is in the frame.
fn reflecting_in(layer: u32, at: vec2i) -> u32 {
    return reflecting_at[(layer * u32(reflecting.rows) + u32(at.y)) * u32(reflecting.columns) + u32(at.x)];
}

// Vector `k` of a fragment.
fn of_fragment(fragment: u32, k: u32) -> vec4f {
    return reflecting_fragments[4u * (fragment - 1u) + k];
}

fn surface_of(fragment: u32) -> u32 {
    return bitcast<u32>(of_fragment(fragment, 3u).y);
}

// The fragment of `surface` at the sample `at`: that of layer `own` before others; fragment 0 if there is none.
fn fragment_of(at: vec2i, surface: u32, own: u32) -> Met {
    let first = reflecting_in(own, at);
    if first != 0u && surface_of(first) == surface {
        return Met(own, first);
    }
    for (var layer = 0u; layer < reflecting.layers; layer++) {
        let other = reflecting_in(layer, at);
        if layer != own && other != 0u && surface_of(other) == surface {
            return Met(layer, other);
        }
    }
    return Met(own, 0u);
}

// The fragment whose reflection `ray` sees in the curved surface that it has met.
fn seen_on_curve(met: Met, ray: LensRay) -> u32 {
    let surface = surface_of(met.fragment);
    let lens = ray.step / reflecting.supersample;
    let begin = ray.start + of_fragment(met.fragment, 0u).w * ray.step;
    var place = met.fragment;
    for (var step = 0u; step < REFLECTION_STEPS; step++) {
        let movement = of_fragment(place, 1u);
        let by = vec2f(movement.x * lens.x + movement.y * lens.y, movement.z * lens.x + movement.w * lens.y);
        let at = in_frame(vec2i(floor(begin + by * reflecting.supersample)));
        let found = fragment_of(at, surface, met.layer);
        if found.fragment == 0u {
            break;
        }
        place = found.fragment;
    }
    return place;
}

// The fragment that `ray` meets behind the flat mirror that it has met.
fn seen_behind_mirror(met: Met, ray: LensRay) -> u32 {
    let last = of_fragment(met.fragment, 3u);
    let surface = bitcast<u32>(last.y);
    var enter = of_fragment(met.fragment, 0u).w;
    var cell = cell_at(ray, enter);
    var passed = met.fragment;
    var passed_px = of_fragment(met.fragment, 2u).y;
    loop {
        let exit = leaves(ray, cell, 1);
        let found = fragment_of(in_frame(cell), surface, met.layer);
        if found.fragment != 0u {
            let mirrored = of_fragment(found.fragment, 2u);
            if mirrored.x <= exit.coc && mirrored.y >= enter {
                return found.fragment;
            }
            if mirrored.y > passed_px - REFLECTION_JOIN_PX {
                passed = found.fragment;
                passed_px = mirrored.y;
            }
        }
        if exit.coc >= last.x {
            break;
        }
        cell += exit.side;
        enter = exit.coc;
    }
    return passed;
}

// What changes for `ray` in the light of the fragment that it has met: that of `layer` at the sample `at`.
fn moved_light(layer: u32, at: vec2i, ray: LensRay) -> MovedLight {
    if !REFLECTS {
        return NOTHING_MOVES;
    }
    let fragment = reflecting_in(layer, at);
    if fragment == 0u {
        return NOTHING_MOVES;
    }
    let met = Met(layer, fragment);
    let shares = of_fragment(fragment, 2u).zw;
    let share = shares.x + shares.y;
    if share <= 0.0 {
        return NOTHING_MOVES;
    }
    var seen = vec3f(0.0);
    if shares.x > 0.0 {
        seen += shares.x * of_fragment(seen_behind_mirror(met, ray), 0u).rgb;
    }
    if shares.y > 0.0 {
        seen += shares.y * of_fragment(seen_on_curve(met, ray), 0u).rgb;
    }
    return MovedLight(share * of_fragment(fragment, 0u).rgb, seen, share);
}

// `moved_light` in the fragment of CoC radius `coc` at the sample `at`, whatever its layer.
fn moved_at(at: vec2i, coc: f32, ray: LensRay) -> MovedLight {
    if !REFLECTS {
        return NOTHING_MOVES;
    }
    for (var layer = 0u; layer < reflecting.layers; layer++) {
        let fragment = reflecting_in(layer, at);
        if fragment == 0u {
            continue;
        }
        let moves = dot(of_fragment(fragment, 2u).zw, vec2f(1.0)) > 0.0;
        if moves && of_fragment(fragment, 0u).w == coc {
            return moved_light(layer, at, ray);
        }
    }
    return NOTHING_MOVES;
}
