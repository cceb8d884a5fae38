// The stack for rays: lists of fragments, N-buffers, lens samples. Reads the tables of src/methods/shared/fragments.rs and
// nbuffer.rs. Comes after ray_sums.wgsl.
//
// At CoC radius c a ray is at sample position start + c·step. Positions are those of the whole stack, independent of the rows
// that are uploaded.

// The rows of the stack that a band reads, and the rows of the picture that it makes.
struct Stack {
    // Width of the picture; first row that the band makes, and number of rows.
    width: u32,
    row: u32,
    rows: u32,
    // Samples per pixel along each axis.
    supersample: f32,
    // Width and height of the whole stack in samples; first and last row of samples that is uploaded.
    columns: u32,
    height: u32,
    top: u32,
    bottom: u32,
    // Maximum number of fragments per sample.
    depth: u32,
    // The grid of blocks of the N-buffers; reciprocal of a block's side in samples.
    block_columns: u32,
    block_rows: u32,
    blocks_per_sample: f32,
}

// A lens sample, in samples: position in the pixel, and step per pixel of CoC radius.
struct View {
    start_x: f32,
    start_y: f32,
    step_x: f32,
    step_y: f32,
}

@group(0) @binding(3) var<uniform> stack: Stack;
@group(0) @binding(4) var<storage, read> views: array<View>;
// [row][column][fragment]: CoC radius in pixels, ascending; ABSENT past the last fragment.
@group(0) @binding(5) var<storage, read> coc_px: array<f32>;
// The same layout for red and green, and for blue and alpha.
@group(0) @binding(6) var<storage, read> red_green: array<vec2f>;
@group(0) @binding(7) var<storage, read> blue_alpha: array<vec2f>;
// NBUFFER_WORDS for each N-buffer: the index where it begins, and its number of levels; then words of the method's own; then the
// bits of the N-buffers, [buffer][level][row][column].
@group(0) @binding(8) var<storage, read> nbuffers: array<u32>;

// Constants from the program: NBUFFER_WORDS; ABSENT, larger than any CoC radius; OPAQUE_ALPHA.

struct Ray {
    start: vec2f,
    step: vec2f,
}

// A rectangle of blocks; `end` is exclusive.
struct Window {
    begin: vec2u,
    end: vec2u,
}

// The sample position of the centre of a pixel.
fn centre_of(pixel: vec2u) -> vec2f {
    return (vec2f(pixel) + 0.5) * stack.supersample;
}

// The ray of a view through the pixel with its centre at sample position `centre`.
fn ray_of(view: u32, centre: vec2f) -> Ray {
    let own = views[view];
    return Ray(centre + vec2f(own.start_x, own.start_y), vec2f(own.step_x, own.step_y));
}

fn ray_at(ray: Ray, c: f32) -> vec2f {
    return ray.start + c * ray.step;
}

// The sum of `ray`, which has collected `color` and has the transmittance `left` after all fragments.
fn ended(ray: Ray, color: vec3f, left: f32) -> Sum {
    return ended_ray(color, left, ray.start, ray.step, stack.supersample);
}

// Index where the list of the sample at `position` begins; past the border, the nearest border sample's.
fn list_at(position: vec2f) -> u32 {
    let first = vec2f(0.0, f32(stack.top));
    let last = vec2f(f32(stack.columns - 1u), f32(stack.bottom));
    let cell = vec2u(clamp(position, first, last));
    return ((cell.y - stack.top) * stack.columns + cell.x) * stack.depth;
}

// Colour of a fragment: red, green, blue (premultiplied) and alpha.
fn color_of(index: u32) -> vec4f {
    return vec4f(red_green[index], blue_alpha[index]);
}

// Transmittance of a fragment of `alpha`.
fn let_through(alpha: f32) -> f32 {
    return select(1.0 - alpha, 0.0, alpha >= OPAQUE_ALPHA);
}

// The blocks that overlap the rectangle between two sample positions, clipped to the frame.
fn window_between(a: vec2f, b: vec2f) -> Window {
    let last = vec2f(f32(stack.block_columns - 1u), f32(stack.block_rows - 1u));
    let begin = vec2u(clamp(min(a, b) * stack.blocks_per_sample, vec2f(0.0), last));
    let end = max(vec2u(clamp(max(a, b) * stack.blocks_per_sample, vec2f(0.0), last)), begin) + 1u;
    return Window(begin, end);
}

// Minimum of an N-buffer over a window; ABSENT for an empty N-buffer.
fn least_in(nbuffer: u32, window: Window) -> f32 {
    let levels = nbuffers[NBUFFER_WORDS * nbuffer + 1u];
    if levels == 0u {
        return ABSENT;
    }
    let shorter = min(window.end.x - window.begin.x, window.end.y - window.begin.y);
    let level = min(firstLeadingBit(shorter), levels - 1u);
    let side = 1u << level;
    let values = nbuffers[NBUFFER_WORDS * nbuffer] + level * stack.block_columns * stack.block_rows;
    var minimum = ABSENT;
    for (var y = window.begin.y; y < window.end.y; y += side) {
        let row = values + min(y, window.end.y - side) * stack.block_columns;
        for (var x = window.begin.x; x < window.end.x; x += side) {
            minimum = min(minimum, bitcast<f32>(nbuffers[row + min(x, window.end.x - side)]));
        }
    }
    return minimum;
}
