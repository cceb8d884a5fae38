// The stack as `shear` sees it: bins, keys and smoothed colours, and where each bin is. Declarations: shear.wgsl.
//
//   find_bins        CoC radius → bin
//   join_bins        bin → key: the bin, which neighbouring bins the fragment joins, whether it is opaque
//   smooth_rows      the prefilter along rows, a thread a row
//   smooth_columns   the prefilter along columns, a thread a column
//   mark_blocks      which bins each block of pixels holds
//   mark_windows     which bins each window of blocks holds: what a tile can see, wherever a view moves it
//   mark_far         the same for a square of tiles

@compute @workgroup_size(16, 16)
fn find_bins(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= params.width || at.y >= params.source_rows {
        return;
    }
    let c = coc_px[at.y * params.width + at.x];
    let alpha = colors[at.y * params.stride + at.x].a;
    var bin = EMPTY;
    if alpha > 0.0 {
        let cell = u32(max((c - params.start_px) * params.cells_per_px, 0.0));
        bin = first_in_cell[min(cell, params.cells - 1u)];
        bin += u32(c >= bin_ends_px[bin]);
        bin |= select(0u, OPAQUE, alpha >= OPAQUE_ALPHA);
    }
    textureStore(fragments_made, at.xy, params.layer, vec4u(bitcast<u32>(c), bin, 0u, 0u));
}

// The bits by which the fragment `own` joins the neighbour in `layer` at `place`, if that is of its surface; FOUND says that it is.
const FOUND = 4u;

fn joined(own: vec2u, place: vec2u, layer: u32) -> u32 {
    let other = textureLoad(fragments, place, layer, 0).xy;
    let bin = own.y & EMPTY;
    let other_bin = other.y & EMPTY;
    let near = abs(bitcast<f32>(other.x) - bitcast<f32>(own.x)) < JOIN_PX;
    let bits = FOUND | select(0u, NEARER, other_bin < bin) | select(0u, FARTHER, other_bin > bin);
    return select(0u, bits, near && other_bin != EMPTY);
}

// The bits by which the fragment `own` of `layer` joins its neighbours at `place`: a surface goes on in its own peel; only where
// another begins there may it go on in any other.
fn joined_at(own: vec2u, layer: u32, place: vec2u) -> u32 {
    var bits = joined(own, place, layer);
    for (var other = 0u; bits == 0u && other < params.layers; other++) {
        if other != layer {
            bits = joined(own, place, other);
        }
    }
    return bits;
}

fn key_of(layer: u32, at: vec2u) -> u32 {
    if layer >= params.layers {
        return NO_KEY;
    }
    let own = textureLoad(fragments, at, layer, 0).xy;
    if own.y == EMPTY {
        return NO_KEY;
    }
    // Translucent fragments join nothing: they would count twice.
    var bits = 0u;
    if (own.y & OPAQUE) != 0u {
        if at.y > 0u {
            bits |= joined_at(own, layer, at - vec2u(0u, 1u));
        }
        if at.y + 1u < params.source_rows {
            bits |= joined_at(own, layer, at + vec2u(0u, 1u));
        }
        if at.x > 0u {
            bits |= joined_at(own, layer, at - vec2u(1u, 0u));
        }
        if at.x + 1u < params.width {
            bits |= joined_at(own, layer, at + vec2u(1u, 0u));
        }
    }
    return ((own.y & EMPTY) << BIN_SHIFT) | (bits & (NEARER | FARTHER));
}

@compute @workgroup_size(16, 16)
fn join_bins(@builtin(global_invocation_id) at: vec3u) {
    if at.x >= params.width || at.y >= params.source_rows {
        return;
    }
    let layer = 4u * at.z;
    let first = key_of(layer, at.xy) | (key_of(layer + 1u, at.xy) << 16u);
    let second = key_of(layer + 2u, at.xy) | (key_of(layer + 3u, at.xy) << 16u);
    textureStore(keys_made, at.xy, at.z, vec4u(first, second, 0u, 0u));
}

// The weight of the other of two neighbours in the mean at one with CoC radius `c`: see src/methods/shear/prefilter.rs.
fn smoothing(c: f32, other_c: f32, alpha: f32, other_alpha: f32) -> f32 {
    let radius = abs(c) * params.radius_per_coc;
    let variance = radius * radius * (1.0 / 3.0);
    let v = max(variance, 1e-4);
    let a = (v + 1.0 - sqrt(1.0 + 2.0 * v)) / v;
    let same = alpha > 0.0 && alpha == other_alpha;
    return select(0.0, a, same && abs(c - other_c) < SURFACE_PX && variance > LEAST_VARIANCE);
}

// A line of samples: where it begins among the colours and among the CoC radii, how far its samples lie apart there, and how many
// there are.
struct Line {
    color: u32,
    coc: u32,
    color_step: u32,
    coc_step: u32,
    count: u32,
}

// Smooths a line, there and back. The weight between two neighbours is by the farther one's CoC radius.
fn smooth_line(line: Line) {
    var last = colors[line.color];
    var last_c = coc_px[line.coc];
    for (var i = 1u; i < line.count; i++) {
        let here = line.color + i * line.color_step;
        let c = coc_px[line.coc + i * line.coc_step];
        var color = colors[here];
        let a = smoothing(c, last_c, color.a, last.a);
        if a > 0.0 {
            color = vec4f((1.0 - a) * color.rgb + a * last.rgb, color.a);
            colors[here] = color;
        }
        last = color;
        last_c = c;
    }
    for (var i = line.count - 1u; i > 0u; i--) {
        let here = line.color + (i - 1u) * line.color_step;
        let c = coc_px[line.coc + (i - 1u) * line.coc_step];
        var color = colors[here];
        let a = smoothing(last_c, c, last.a, color.a);
        if a > 0.0 {
            color = vec4f((1.0 - a) * color.rgb + a * last.rgb, color.a);
            colors[here] = color;
        }
        last = color;
        last_c = c;
    }
}

@compute @workgroup_size(64)
fn smooth_rows(@builtin(global_invocation_id) at: vec3u) {
    if at.x < params.source_rows {
        smooth_line(Line(at.x * params.stride, at.x * params.width, 1u, 1u, params.width));
    }
}

@compute @workgroup_size(64)
fn smooth_columns(@builtin(global_invocation_id) at: vec3u) {
    if at.x < params.width {
        smooth_line(Line(at.x, at.x, params.stride, params.width, params.source_rows));
    }
}

fn blocks_size() -> vec2u {
    return (vec2u(params.width, params.source_rows) + (BLOCK - 1u)) / BLOCK;
}

// The bins of `word` that `key` is in.
fn bins_of(key: u32, word: u32) -> u32 {
    let nearer = key & NEARER;
    let bins = (2u << (nearer + ((key & FARTHER) / FARTHER))) - 1u;
    let first = i32((key >> BIN_SHIFT) - nearer) - i32(32u * word);
    let from_here = select(0u, bins << u32(first & 31), first >= 0 && first < 32);
    let from_before = select(0u, bins >> u32(-first & 31), first < 0 && first > -3);
    return select(from_here | from_before, 0u, key == NO_KEY);
}

@compute @workgroup_size(8, 8)
fn mark_blocks(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(BLOCK * (at.xy + 1u), vec2u(params.width, params.source_rows));
    var bits = 0u;
    for (var slice = 0u; 4u * slice < params.layers; slice++) {
        for (var y = BLOCK * at.y; y < end.y; y++) {
            for (var x = BLOCK * at.x; x < end.x; x++) {
                let four = textureLoad(keys, vec2u(x, y), slice, 0).xy;
                bits |= bins_of(four.x & 0xffffu, at.z) | bins_of(four.x >> 16u, at.z);
                bits |= bins_of(four.y & 0xffffu, at.z) | bins_of(four.y >> 16u, at.z);
            }
        }
    }
    blocks[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

@compute @workgroup_size(8, 8)
fn mark_windows(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(at.xy + WINDOW, size);
    var bits = 0u;
    for (var y = at.y; y < end.y; y++) {
        for (var x = at.x; x < end.x; x++) {
            bits |= blocks[(at.z * size.y + y) * size.x + x];
        }
    }
    windows[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

@compute @workgroup_size(8, 8)
fn mark_far(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let step = TILE / BLOCK;
    let end = min(at.xy + SQUARE * step, size);
    var bits = 0u;
    for (var y = at.y; y < end.y; y += step) {
        for (var x = at.x; x < end.x; x += step) {
            bits |= windows[(at.z * size.y + y) * size.x + x];
        }
    }
    far_windows[(at.z * size.y + at.y) * size.x + at.x] = bits;
}
