// The lists of `shear`: for each tile and view the groups of bins that may be visible. Declarations: shear.wgsl.
//
//   find_block_bins          the bins of each block of pixels
//   find_window_bins         the bins of each window of blocks, which holds all fragments of a tile moved by a shift
//   find_square_window_bins  the same for a square of tiles
//   find_block_occluders     the bins of the first layer in each block, if it occludes all others there
//   find_window_occluders    the same for each window
//   find_square_bins         the bins that may be visible in each square of tiles, for each view
//   find_groups              of those, the groups of bins that may be visible in each tile, for each view
//   sort_views               the order of the views of each tile: those in which an occluder covers the tile come first

fn blocks_size() -> vec2u {
    return (vec2u(params.width, params.source_rows) + (BLOCK - 1u)) / BLOCK;
}

// The bins of `key` that lie in word `word`, one bit each.
fn bins_of(key: u32, word: u32) -> u32 {
    let bins = (2u << ((key >> EXTRA_SHIFT) & EXTRA_MASK)) - 1u;
    let first = i32(key >> BIN_SHIFT) - i32(32u * word);
    let from_here = select(0u, bins << u32(first & 31), first >= 0 && first < 32);
    let from_before = select(0u, bins >> u32(-first & 31), first < 0 && first > -3);
    return select(from_here | from_before, 0u, key == NO_KEY);
}

@compute @workgroup_size(8, 8)
fn find_block_bins(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(BLOCK * (at.xy + 1u), vec2u(params.width, params.source_rows));
    var bits = 0u;
    for (var slice = 0u; 4u * slice < params.layers; slice++) {
        for (var y = BLOCK * at.y; y < end.y; y++) {
            for (var x = BLOCK * at.x; x < end.x; x++) {
                let key = keys_at(vec2u(x, y), slice);
                bits |= bins_of(key.x, at.z) | bins_of(key.y, at.z);
                bits |= bins_of(key.z, at.z) | bins_of(key.w, at.z);
            }
        }
    }
    block_bins[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

@compute @workgroup_size(8, 8)
fn find_window_bins(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(at.xy + WINDOW, size);
    var bits = 0u;
    for (var y = at.y; y < end.y; y++) {
        for (var x = at.x; x < end.x; x++) {
            bits |= block_bins[(at.z * size.y + y) * size.x + x];
        }
    }
    window_bins[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

@compute @workgroup_size(8, 8)
fn find_square_window_bins(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let step = TILE / BLOCK;
    let end = min(at.xy + SQUARE * step, size);
    var bits = 0u;
    for (var y = at.y; y < end.y; y += step) {
        for (var x = at.x; x < end.x; x += step) {
            bits |= window_bins[(at.z * size.y + y) * size.x + x];
        }
    }
    square_window_bins[(at.z * size.y + at.y) * size.x + at.x] = bits;
}

// The smallest and largest first bin of the first layer, if at each sample it is opaque and no other layer begins in a nearer
// bin: a group with all of these bins occludes every ray there. Otherwise `last` lies past all bins.
struct Occluder {
    first: u32,
    last: u32,
}

fn packed_occluder(occluder: Occluder) -> u32 {
    return occluder.first | (occluder.last << 16u);
}

fn unpacked_occluder(word: u32) -> Occluder {
    return Occluder(word & 0xffffu, word >> 16u);
}

// The occluder of two regions together.
fn merged(a: Occluder, b: Occluder) -> Occluder {
    return Occluder(min(a.first, b.first), max(a.last, b.last));
}

// The first layer at `source`.
fn occluder_at(source: vec2u) -> Occluder {
    // The first bin of NO_KEY lies past all bins.
    let own = keys_at(source, 0u);
    var others = min(own.y, min(own.z, own.w));
    for (var slice = 1u; 4u * slice < params.layers; slice++) {
        let deeper = keys_at(source, slice);
        others = min(others, min(min(deeper.x, deeper.y), min(deeper.z, deeper.w)));
    }
    let first = own.x >> BIN_SHIFT;
    let occludes = own.x != NO_KEY && (own.x & OPAQUE) != 0u && (others >> BIN_SHIFT) >= first;
    return Occluder(first, select(NO_KEY, first, occludes));
}

@compute @workgroup_size(8, 8)
fn find_block_occluders(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(BLOCK * (at.xy + 1u), vec2u(params.width, params.source_rows));
    var occluder = Occluder(NO_KEY, 0u);
    for (var y = BLOCK * at.y; y < end.y; y++) {
        for (var x = BLOCK * at.x; x < end.x; x++) {
            occluder = merged(occluder, occluder_at(vec2u(x, y)));
        }
    }
    block_occluders[at.y * size.x + at.x] = packed_occluder(occluder);
}

@compute @workgroup_size(8, 8)
fn find_window_occluders(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(at.xy + WINDOW, size);
    var occluder = Occluder(NO_KEY, 0u);
    for (var y = at.y; y < end.y; y++) {
        for (var x = at.x; x < end.x; x++) {
            occluder = merged(occluder, unpacked_occluder(block_occluders[y * size.x + x]));
        }
    }
    window_occluders[at.y * size.x + at.x] = packed_occluder(occluder);
}

// The sample at `pixel` of the band moved by `shift`; past the border the border's sample.
fn source_of(pixel: vec2u, shift: vec2i) -> vec2u {
    let position = vec2i(pixel) + vec2i(0, i32(params.band_start)) + shift;
    let inside = clamp(position, vec2i(0), vec2i(vec2u(params.width, params.height)) - 1);
    return vec2u(u32(inside.x), min(u32(inside.y) - params.source_start, params.source_rows - 1u));
}

fn tiles_size() -> vec2u {
    return (vec2u(params.width, params.band_rows) + (TILE - 1u)) / TILE;
}

// Columns and rows of a shift, 16 bits each.
fn unpacked_shift(word: u32) -> vec2i {
    return vec2i(i32(word << 16u) >> 16u, i32(word) >> 16u);
}

// The neighbouring bins first .. end, which a view moves by the same shift.
struct Group {
    first: u32,
    end: u32,
    shift: u32,
}

// Bits of an entry: its first bin and its end, and flags: the last entry of its list, a group in which the first layer covers
// the tile and occludes every ray, and whether that layer is in focus.
const END_SHIFT = 13u;
const BIN_MASK = 0x1fffu;
const LAST = 0x4000000u;
const COVERED = 0x8000000u;
const COVERED_IN_FOCUS = 0x10000000u;

fn packed(group: Group, flags: u32) -> vec2u {
    return vec2u(group.shift, group.first | (group.end << END_SHIFT) | flags);
}

fn unpacked(entry: vec2u) -> Group {
    return Group(entry.y & BIN_MASK, (entry.y >> END_SHIFT) & BIN_MASK, entry.x);
}

// The shift of `bin` in `view`, packed.
fn shift_of(view: u32, bin: u32) -> u32 {
    let i = view * params.bins + bin;
    return shifts[i >> 2u][i & 3u];
}

// Index of the window of the tile or square that begins at pixel `corner`, moved by `shift`.
fn window_of(corner: vec2u, shift: u32) -> u32 {
    let block = source_of(corner, unpacked_shift(shift)) / BLOCK;
    return block.y * blocks_size().x + block.x;
}

// Index of the word of `window` that has `bin`.
fn word_of(window: u32, bin: u32) -> u32 {
    let size = blocks_size();
    return (bin >> 5u) * size.x * size.y + window;
}

// Flags of `group` for a tile with `occluder`: COVERED if the first layer occludes every ray in it, and all of it is in focus
// or none.
fn covered_flags(group: Group, occluder: Occluder) -> u32 {
    let covers = occluder.first >= group.first && occluder.last < group.end;
    let focused = occluder.first >= params.focused_start && occluder.last < params.focused_end;
    let blurred = occluder.last < params.focused_start || occluder.first >= params.focused_end;
    return select(0u, COVERED | select(0u, COVERED_IN_FOCUS, focused), covers && (focused || blurred));
}

fn squares_size() -> vec2u {
    return (tiles_size() + (SQUARE - 1u)) / SQUARE;
}

@compute @workgroup_size(64)
fn find_square_bins(@builtin(global_invocation_id) at: vec3u) {
    let squares = squares_size();
    if at.x >= squares.x {
        return;
    }
    let corner = SQUARE * TILE * at.xy;
    let bins = ((at.y * squares.x + at.x) * params.batch_views + at.z) * params.words;
    for (var word = 0u; word < params.words; word++) {
        let count = min(32u, params.bins - 32u * word);
        var bits = 0u;
        for (var bit = 0u; bit < count; bit++) {
            let bin = 32u * word + bit;
            bits |= square_window_bins[word_of(window_of(corner, shift_of(at.z, bin)), bin)] & (1u << bit);
        }
        square_bins[bins + word] = bits;
    }
}

@compute @workgroup_size(64)
fn find_groups(@builtin(global_invocation_id) at: vec3u) {
    let tiles = tiles_size();
    if at.x >= tiles.x {
        return;
    }
    let square = at.y / SQUARE * squares_size().x + at.x / SQUARE;
    let bins = (square * params.batch_views + at.z) * params.words;
    let list = ((at.y * tiles.x + at.x) * params.batch_views + at.z) * params.entries;
    // The list of a tile without fragments has one group, without bins.
    var group = Group(BIN_MASK, BIN_MASK, 0u);
    var occluder = Occluder(NO_KEY, NO_KEY);
    var covered = 0u;
    var count = 1u;
    var word = 0u;
    var bits = square_bins[bins];
    loop {
        if bits == 0u {
            word++;
            if word == params.words {
                break;
            }
            bits = square_bins[bins + word];
            continue;
        }
        let bin = 32u * word + firstTrailingBit(bits);
        bits &= bits - 1u;
        let shift = shift_of(at.z, bin);
        let window = window_of(TILE * at.xy, shift);
        let is_first = group.first == BIN_MASK;
        if !is_first && shift == group.shift {
            group.end = bin + 1u;
        } else if ((window_bins[word_of(window, bin)] >> (bin & 31u)) & 1u) == 1u {
            if !is_first {
                if count < params.entries {
                    groups[list + count - 1u] = packed(group, 0u);
                }
                count++;
            }
            group = Group(bin, bin + 1u, shift);
            occluder = unpacked_occluder(window_occluders[window]);
        }
        covered = covered_flags(group, occluder);
        if covered != 0u {
            break;
        }
    }
    if count <= params.entries {
        groups[list + count - 1u] = packed(group, LAST | covered);
    }
    atomicMax(&longest_list, count);
}

@compute @workgroup_size(64)
fn sort_views(@builtin(global_invocation_id) at: vec3u) {
    let tiles = tiles_size();
    if at.x >= tiles.x {
        return;
    }
    let tile = at.y * tiles.x + at.x;
    let views = tile * params.batch_views;
    var first = 0u;
    var end = params.batch_views;
    for (var view = 0u; view < params.batch_views; view++) {
        let head = groups[(views + view) * params.entries];
        let is_covered = (head.y & COVERED) != 0u;
        end -= select(1u, 0u, is_covered);
        let focused = select(0u, FOCUSED_FLAG, (head.y & COVERED_IN_FOCUS) != 0u);
        ordered_views[views + select(end, first, is_covered)] = vec2u(head.x, view | focused);
        first += select(0u, 1u, is_covered);
    }
    covered_views[tile] = first;
}
