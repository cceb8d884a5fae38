// The stack as rays read it: lists of fragments, N-buffers, lens samples; twin of src/methods/shared/fragments.rs and nbuffer.rs, whose
// tables these are. Comes after ray_sums.wgsl.
//
// A ray is over sample position start + c·step at CoC radius c. Positions are those of the whole stack, whichever rows of it are at
// hand.

// The rows of the stack at hand, and those of the picture that are made of them.
struct Stack {
    // Columns of the picture; its first row that is made, and how many are.
    width: u32,
    row: u32,
    rows: u32,
    // Samples of a pixel along each axis.
    supersample: f32,
    // Columns and rows of the whole stack, in samples; the first of its rows at hand, and the last.
    columns: u32,
    height: u32,
    top: u32,
    bottom: u32,
    // Fragments that a sample may have.
    depth: u32,
    // The grid of blocks that N-buffers are kept for, and blocks a sample.
    block_columns: u32,
    block_rows: u32,
    blocks_per_sample: f32,
}

// A lens sample, as rays need it: where in the pixel, and how far for each pixel of CoC radius, in samples.
struct View {
    start_x: f32,
    start_y: f32,
    step_x: f32,
    step_y: f32,
}

@group(0) @binding(3) var<uniform> stack: Stack;
@group(0) @binding(4) var<storage, read> views: array<View>;
// [row][column][fragment]: CoC radius, rising; ABSENT where there is no further fragment.
@group(0) @binding(5) var<storage, read> coc_px: array<f32>;
// The same for red and green, and for blue and alpha.
@group(0) @binding(6) var<storage, read> red_green: array<vec2f>;
@group(0) @binding(7) var<storage, read> blue_alpha: array<vec2f>;
// NBUFFER_WORDS for each N-buffer: where it begins, and how many levels it has; then what else the method keeps here; then the bits
// of the N-buffers, [buffer][level][row][column].
@group(0) @binding(8) var<storage, read> nbuffers: array<u32>;

// The program's are NBUFFER_WORDS; ABSENT, farther than any fragment; and OPAQUE_ALPHA.

struct Ray {
    start: vec2f,
    step: vec2f,
}

// Blocks, from the first to before the last.
struct Window {
    begin: vec2u,
    end: vec2u,
}

// The sample position of the centre of a pixel.
fn centre_of(pixel: vec2u) -> vec2f {
    return (vec2f(pixel) + 0.5) * stack.supersample;
}

// The ray of a view through the pixel whose centre is at sample position `centre`.
fn ray_of(view: u32, centre: vec2f) -> Ray {
    let own = views[view];
    return Ray(centre + vec2f(own.start_x, own.start_y), vec2f(own.step_x, own.step_y));
}

fn ray_at(ray: Ray, c: f32) -> vec2f {
    return ray.start + c * ray.step;
}

// Where the list of the sample at `position` begins; past the border it is the border's.
fn list_at(position: vec2f) -> u32 {
    let least = vec2f(0.0, f32(stack.top));
    let last = vec2f(f32(stack.columns - 1u), f32(stack.bottom));
    let place = vec2u(clamp(position, least, last));
    return ((place.y - stack.top) * stack.columns + place.x) * stack.depth;
}

// What a fragment shows: red, green, blue (premultiplied) and alpha.
fn color_of(index: u32) -> vec4f {
    return vec4f(red_green[index], blue_alpha[index]);
}

// Share of the light behind something of `alpha` that it lets through.
fn let_through(alpha: f32) -> f32 {
    return select(1.0 - alpha, 0.0, alpha >= OPAQUE_ALPHA);
}

// The blocks that hold the rectangle between two sample positions, cut off at the frame.
fn window_between(a: vec2f, b: vec2f) -> Window {
    let last = vec2f(f32(stack.block_columns - 1u), f32(stack.block_rows - 1u));
    let begin = vec2u(clamp(min(a, b) * stack.blocks_per_sample, vec2f(0.0), last));
    let end = max(vec2u(clamp(max(a, b) * stack.blocks_per_sample, vec2f(0.0), last)), begin) + 1u;
    return Window(begin, end);
}

// The least value of an N-buffer in a window; ABSENT where it has none at all.
fn least_in(nbuffer: u32, window: Window) -> f32 {
    let levels = nbuffers[NBUFFER_WORDS * nbuffer + 1u];
    if levels == 0u {
        return ABSENT;
    }
    let shorter = min(window.end.x - window.begin.x, window.end.y - window.begin.y);
    let level = min(firstLeadingBit(shorter), levels - 1u);
    let side = 1u << level;
    let values = nbuffers[NBUFFER_WORDS * nbuffer] + level * stack.block_columns * stack.block_rows;
    var least = ABSENT;
    for (var y = window.begin.y; y < window.end.y; y += side) {
        let row = values + min(y, window.end.y - side) * stack.block_columns;
        for (var x = window.begin.x; x < window.end.x; x += side) {
            least = min(least, bitcast<f32>(nbuffers[row + min(x, window.end.x - side)]));
        }
    }
    return least;
}
