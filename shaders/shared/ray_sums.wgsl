// Sums over the rays of each pixel, in batches of views. CPU version: `RaySum` in src/methods/shared/ray_sum.rs.
//
// resolve   computes the picture: the mean over all rays
//
// A batch has some of the views. Its sum is computed separately and then added to the sum of the batches before it, so that each
// sum has few terms and single precision suffices.

// Some of the views of one set, and where the rays of a pixel begin and end.
struct Batch {
    // First view, and end of the range of views (exclusive).
    first_view: u32,
    end_view: u32,
    // Whether this is the first batch: it overwrites the sums.
    begins: u32,
    // Bit k is set where these views render channel k of the picture.
    channels: u32,
    // Number of pixels of the band.
    pixels: u32,
    // Whether the background is visible.
    shows_background: u32,
    // Whether lost rays count as opaque black; otherwise they are left out of the mean.
    lost_are_black: u32,
    // Extent of the rays' origins in a pixel, as a fraction of its width: by pixel, or the same in all.
    jitter_by_pixel: u32,
    jitter: f32,
    // Width of the picture; first and last row of `pixels` that is uploaded; CoC radius at infinity in pixels.
    columns: i32,
    top: i32,
    bottom: i32,
    coc_infinity_px: f32,
}

// Sum over some rays.
struct Sum {
    // Premultiplied colour.
    color: vec3f,
    // Rays that hit something; translucent fragments count fractions of a ray.
    hit: f32,
    // Rays that end in the background, weighted by transmittance.
    transparent: f32,
    // All rays that were not discarded. Those that neither hit anything nor end in the background are lost.
    rays: f32,
}

@group(0) @binding(0) var<uniform> batch: Batch;
// [red, green, blue, hit, rays, transparent][row][column]; without the last where the background is not visible.
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;
// [red, green, blue, alpha][row][column].
@group(0) @binding(2) var<storage, read_write> picture: array<f32>;

// [row][column]: share of the background in the pixel, CoC radius of the pixel's last fragment, extent of the rays' origins, and share of
// the background behind a fragment that a ray passes beside in the pixel.
@group(0) @binding(14) var<storage, read> pixels: array<vec4f>;

const NO_RAYS: Sum = Sum(vec3f(0.0), 0.0, 0.0, 0.0);

// Constant from the program: MIN_HIT, the fraction of rays above which a pixel counts as hit.

fn saved_sum(pixel: u32) -> Sum {
    let color = vec3f(sums[pixel], sums[batch.pixels + pixel], sums[2u * batch.pixels + pixel]);
    var transparent = 0.0;
    if batch.shows_background != 0u {
        transparent = sums[5u * batch.pixels + pixel];
    }
    return Sum(color, sums[3u * batch.pixels + pixel], transparent, sums[4u * batch.pixels + pixel]);
}

fn save_sum(pixel: u32, sum: Sum) {
    sums[pixel] = sum.color.r;
    sums[batch.pixels + pixel] = sum.color.g;
    sums[2u * batch.pixels + pixel] = sum.color.b;
    sums[3u * batch.pixels + pixel] = sum.hit;
    sums[4u * batch.pixels + pixel] = sum.rays;
    if batch.shows_background != 0u {
        sums[5u * batch.pixels + pixel] = sum.transparent;
    }
}

fn added(a: Sum, b: Sum) -> Sum {
    return Sum(a.color + b.color, a.hit + b.hit, a.transparent + b.transparent, a.rays + b.rays);
}

// Adds the sum of a batch to the sums of the batches before it.
fn add_batch(pixel: u32, sum: Sum) {
    if batch.begins != 0u {
        save_sum(pixel, sum);
        return;
    }
    save_sum(pixel, added(saved_sum(pixel), sum));
}

// Extent of the rays' origins in a pixel of the picture.
fn jitter_at(pixel: vec2u) -> f32 {
    if batch.jitter_by_pixel == 0u {
        return batch.jitter;
    }
    return pixels[(i32(pixel.y) - batch.top) * batch.columns + i32(pixel.x)].z;
}

// The background's pixel below a ray that at CoC radius c is at sample position `start + c·step`; past the border, the border's
// pixel.
fn background_below(start: vec2f, step: vec2f, supersample: f32, c: f32) -> vec4f {
    // Half a sample more keeps the division away from whole numbers, where it may round down.
    let pixel = vec2i(floor((floor(start + c * step) + 0.5) / supersample));
    let kept = clamp(pixel, vec2i(0, batch.top), vec2i(batch.columns - 1, batch.bottom));
    return pixels[(kept.y - batch.top) * batch.columns + kept.x];
}

// The sum of a ray that has collected `color`, has the transmittance `left` after all fragments, and at CoC radius c is at sample
// position `start + c·step`. CPU version: `Background::met_by`.
fn ended_ray(color: vec3f, left: f32, start: vec2f, step: vec2f, supersample: f32) -> Sum {
    var transparent = 0.0;
    if batch.shows_background != 0u && left > 0.0 {
        let at_infinity = background_below(start, step, supersample, batch.coc_infinity_px);
        var share = at_infinity.x;
        if share < 1.0 {
            share = max(share, background_below(start, step, supersample, at_infinity.y).w);
        }
        transparent = min(left, share);
    }
    return Sum(color, 1.0 - left, transparent, 1.0);
}

// Rays that count as covered in the mean.
fn covered(sum: Sum) -> f32 {
    return select(sum.hit, sum.rays - sum.transparent, batch.lost_are_black != 0u);
}

// Rays in the mean.
fn weight(sum: Sum) -> f32 {
    return select(sum.hit + sum.transparent, sum.rays, batch.lost_are_black != 0u);
}

fn shows_nothing(sum: Sum) -> bool {
    return weight(sum) <= MIN_HIT * sum.rays;
}

// Rays that hit nothing but light without alpha have a colour.
fn mean(sum: Sum) -> vec4f {
    if shows_nothing(sum) {
        return vec4f(0.0);
    }
    let covered = covered(sum);
    return vec4f(sum.color, select(0.0, covered, covered > MIN_HIT * sum.rays)) / weight(sum);
}

@compute @workgroup_size(64)
fn resolve(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let pixel = (group.y * groups.x + group.x) * 64u + local;
    if pixel >= batch.pixels {
        return;
    }
    let value = mean(saved_sum(pixel));
    for (var channel = 0u; channel < 4u; channel++) {
        if (batch.channels >> channel & 1u) != 0u {
            picture[channel * batch.pixels + pixel] = value[channel];
        }
    }
}
