// What each view of `shear` can show to each tile: lists of groups of bins. Declarations: shear.wgsl.
//
//   mark_blocks        which bins each block of pixels holds
//   mark_windows       which bins each window of blocks holds: what a tile can see, wherever a view moves it
//   mark_far           the same for a square of tiles
//   mark_block_walls   in which bins the first layer lies in each block, if it hides all others there
//   mark_walls         the same for each window
//   find_far           the bins that each view can show to each square of tiles
//   find_groups        of those, the groups of bins that it can show to each tile
//   sort_views         the views that show a tile a wall before those that do not

fn blocks_size() -> vec2u {
    return (vec2u(params.width, params.source_rows) + (BLOCK - 1u)) / BLOCK;
}

// The bins of `word` that `key` is in.
fn bins_of(key: u32, word: u32) -> u32 {
    let bins = (2u << ((key >> EXTRA_SHIFT) & EXTRA)) - 1u;
    let first = i32(key >> BIN_SHIFT) - i32(32u * word);
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
                let key = keys_at(vec2u(x, y), slice);
                bits |= bins_of(key.x, at.z) | bins_of(key.y, at.z);
                bits |= bins_of(key.z, at.z) | bins_of(key.w, at.z);
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

// Bins that the first layer begins in, from the least to the greatest, if at each sample it is opaque and no other layer begins before
// it: a group that holds them all stops every ray, there. Else the greatest is past all bins.
struct Wall {
    first: u32,
    last: u32,
}

fn packed_wall(wall: Wall) -> u32 {
    return wall.first | (wall.last << 16u);
}

fn unpacked_wall(word: u32) -> Wall {
    return Wall(word & 0xffffu, word >> 16u);
}

fn both(a: Wall, b: Wall) -> Wall {
    return Wall(min(a.first, b.first), max(a.last, b.last));
}

fn wall_at(place: vec2u) -> Wall {
    // NO_KEY begins past all bins.
    let own = keys_at(place, 0u);
    var others = min(own.y, min(own.z, own.w));
    for (var slice = 1u; 4u * slice < params.layers; slice++) {
        let deeper = keys_at(place, slice);
        others = min(others, min(min(deeper.x, deeper.y), min(deeper.z, deeper.w)));
    }
    let first = own.x >> BIN_SHIFT;
    let hides = own.x != NO_KEY && (own.x & OPAQUE) != 0u && (others >> BIN_SHIFT) >= first;
    return Wall(first, select(NO_KEY, first, hides));
}

@compute @workgroup_size(8, 8)
fn mark_block_walls(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(BLOCK * (at.xy + 1u), vec2u(params.width, params.source_rows));
    var wall = Wall(NO_KEY, 0u);
    for (var y = BLOCK * at.y; y < end.y; y++) {
        for (var x = BLOCK * at.x; x < end.x; x++) {
            wall = both(wall, wall_at(vec2u(x, y)));
        }
    }
    block_walls[at.y * size.x + at.x] = packed_wall(wall);
}

@compute @workgroup_size(8, 8)
fn mark_walls(@builtin(global_invocation_id) at: vec3u) {
    let size = blocks_size();
    if at.x >= size.x || at.y >= size.y {
        return;
    }
    let end = min(at.xy + WINDOW, size);
    var wall = Wall(NO_KEY, 0u);
    for (var y = at.y; y < end.y; y++) {
        for (var x = at.x; x < end.x; x++) {
            wall = both(wall, unpacked_wall(block_walls[y * size.x + x]));
        }
    }
    walls[at.y * size.x + at.x] = packed_wall(wall);
}

// The sample that a view shows at `pixel` of the band where it moves by `shift`: those at the border go on for ever.
fn source_of(pixel: vec2u, shift: vec2i) -> vec2u {
    let place = vec2i(pixel) + vec2i(0, i32(params.band_start)) + shift;
    let inside = clamp(place, vec2i(0), vec2i(vec2u(params.width, params.height)) - 1);
    return vec2u(u32(inside.x), min(u32(inside.y) - params.source_start, params.source_rows - 1u));
}

fn tiles_size() -> vec2u {
    return (vec2u(params.width, params.band_rows) + (TILE - 1u)) / TILE;
}

// Columns and rows that a view moves a bin by, 16 bits each.
fn shift_in(word: u32) -> vec2i {
    return vec2i(i32(word << 16u) >> 16u, i32(word) >> 16u);
}

// Neighbouring bins, from the first to before the end, that a view moves by the same shift.
struct Group {
    first: u32,
    end: u32,
    shift: u32,
}

// Bits of an entry beside its first bin and its end: whether it is the last of its list, whether every ray is stopped in it by the first
// layer, and whether that is in focus.
const END_SHIFT = 13u;
const BIN_MASK = 0x1fffu;
const LAST = 0x4000000u;
const WALL = 0x8000000u;
const WALL_IN_FOCUS = 0x10000000u;

fn packed(group: Group, flags: u32) -> vec2u {
    return vec2u(group.shift, group.first | (group.end << END_SHIFT) | flags);
}

fn unpacked(entry: vec2u) -> Group {
    return Group(entry.y & BIN_MASK, (entry.y >> END_SHIFT) & BIN_MASK, entry.x);
}

fn shift_of(view: u32, bin: u32) -> u32 {
    let i = view * params.bins + bin;
    return shifts[i >> 2u][i & 3u];
}

// Where the window is that the tile or square that begins at pixel `corner` sees where a view moves it by `shift`.
fn window_of(corner: vec2u, shift: u32) -> u32 {
    let block = source_of(corner, shift_in(shift)) / BLOCK;
    return block.y * blocks_size().x + block.x;
}

// Where the word that has `bin` is, among the words of `window`.
fn word_of(window: u32, bin: u32) -> u32 {
    let size = blocks_size();
    return (bin >> 5u) * size.x * size.y + window;
}

// Flags of `group` where `wall` is what the first layer is to a tile: WALL if it stops every ray in it, and all of it is in focus or none.
fn wall_flags(group: Group, wall: Wall) -> u32 {
    let stops = wall.first >= group.first && wall.last < group.end;
    let sharp = wall.first >= params.focused_start && wall.last < params.focused_end;
    let blurred = wall.last < params.focused_start || wall.first >= params.focused_end;
    return select(0u, WALL | select(0u, WALL_IN_FOCUS, sharp), stops && (sharp || blurred));
}

fn squares_size() -> vec2u {
    return (tiles_size() + (SQUARE - 1u)) / SQUARE;
}

@compute @workgroup_size(64)
fn find_far(@builtin(global_invocation_id) at: vec3u) {
    let squares = squares_size();
    if at.x >= squares.x {
        return;
    }
    let corner = SQUARE * TILE * at.xy;
    let bins = ((at.y * squares.x + at.x) * params.views_in_go + at.z) * params.words;
    for (var word = 0u; word < params.words; word++) {
        let count = min(32u, params.bins - 32u * word);
        var bits = 0u;
        for (var bit = 0u; bit < count; bit++) {
            let bin = 32u * word + bit;
            bits |= far_windows[word_of(window_of(corner, shift_of(at.z, bin)), bin)] & (1u << bit);
        }
        far[bins + word] = bits;
    }
}

@compute @workgroup_size(64)
fn find_groups(@builtin(global_invocation_id) at: vec3u) {
    let tiles = tiles_size();
    if at.x >= tiles.x {
        return;
    }
    let square = at.y / SQUARE * squares_size().x + at.x / SQUARE;
    let bins = (square * params.views_in_go + at.z) * params.words;
    let list = ((at.y * tiles.x + at.x) * params.views_in_go + at.z) * params.entries;
    // A list of nothing has one group, that no fragment is in.
    var group = Group(BIN_MASK, BIN_MASK, 0u);
    var wall = Wall(NO_KEY, NO_KEY);
    var stops = 0u;
    var count = 1u;
    var word = 0u;
    var bits = far[bins];
    loop {
        if bits == 0u {
            word++;
            if word == params.words {
                break;
            }
            bits = far[bins + word];
            continue;
        }
        let bin = 32u * word + firstTrailingBit(bits);
        bits &= bits - 1u;
        let shift = shift_of(at.z, bin);
        let window = window_of(TILE * at.xy, shift);
        let is_first = group.first == BIN_MASK;
        if !is_first && shift == group.shift {
            group.end = bin + 1u;
        } else if ((windows[word_of(window, bin)] >> (bin & 31u)) & 1u) == 1u {
            if !is_first {
                if count < params.entries {
                    groups[list + count - 1u] = packed(group, 0u);
                }
                count++;
            }
            group = Group(bin, bin + 1u, shift);
            wall = unpacked_wall(walls[window]);
        }
        stops = wall_flags(group, wall);
        if stops != 0u {
            break;
        }
    }
    if count <= params.entries {
        groups[list + count - 1u] = packed(group, LAST | stops);
    }
    atomicMax(&longest, count);
}

@compute @workgroup_size(64)
fn sort_views(@builtin(global_invocation_id) at: vec3u) {
    let tiles = tiles_size();
    if at.x >= tiles.x {
        return;
    }
    let tile = at.y * tiles.x + at.x;
    let views = tile * params.views_in_go;
    var first = 0u;
    var end = params.views_in_go;
    for (var view = 0u; view < params.views_in_go; view++) {
        let head = groups[(views + view) * params.entries];
        let is_wall = (head.y & WALL) != 0u;
        end -= select(1u, 0u, is_wall);
        let sharp = select(0u, SHARP, (head.y & WALL_IN_FOCUS) != 0u);
        turns[views + select(end, first, is_wall)] = vec2u(head.x, view | sharp);
        first += select(0u, 1u, is_wall);
    }
    turns_of_walls[tile] = first;
}
