// Sums over the rays of each pixel, in batches of views. CPU version: `RaySum` in src/methods/shared/ray_sum.rs.
//
// resolve   computes the picture: the mean over all rays
//
// A batch has some of the views. Its sum is computed separately and then added to the sum of the batches before it, so that each
// sum has few terms and single precision suffices.

// Some of the views of one set.
struct Batch {
    // First view, and end of the range of views (exclusive).
    first_view: u32,
    end_view: u32,
    // Whether this is the first batch: it overwrites the sums.
    begins: u32,
    // Bit k is set where these views render channel k of the picture.
    channels: u32,
    // Whether rays that hit nothing are transparent; otherwise they are left out of the mean.
    transparent_background: u32,
    // Number of pixels of the band.
    pixels: u32,
}

// Sum over some rays.
struct Sum {
    // Premultiplied colour.
    color: vec3f,
    // Rays that hit something; translucent fragments count fractions of a ray.
    hit: f32,
    // Rays that are part of the mean.
    rays: f32,
}

@group(0) @binding(0) var<uniform> batch: Batch;
// [red, green, blue, hit, rays][row][column].
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;
// [red, green, blue, alpha][row][column].
@group(0) @binding(2) var<storage, read_write> picture: array<f32>;

// Constant from the program: MIN_HIT, the fraction of rays above which a pixel counts as hit.

fn saved_sum(pixel: u32) -> Sum {
    let color = vec3f(sums[pixel], sums[batch.pixels + pixel], sums[2u * batch.pixels + pixel]);
    return Sum(color, sums[3u * batch.pixels + pixel], sums[4u * batch.pixels + pixel]);
}

fn save_sum(pixel: u32, sum: Sum) {
    sums[pixel] = sum.color.r;
    sums[batch.pixels + pixel] = sum.color.g;
    sums[2u * batch.pixels + pixel] = sum.color.b;
    sums[3u * batch.pixels + pixel] = sum.hit;
    sums[4u * batch.pixels + pixel] = sum.rays;
}

// Adds the sum of a batch to the sums of the batches before it.
fn add_batch(pixel: u32, sum: Sum) {
    if batch.begins != 0u {
        save_sum(pixel, sum);
        return;
    }
    let before = saved_sum(pixel);
    save_sum(pixel, Sum(before.color + sum.color, before.hit + sum.hit, before.rays + sum.rays));
}

fn shows_nothing(sum: Sum) -> bool {
    return sum.hit <= MIN_HIT * sum.rays;
}

fn mean(sum: Sum) -> vec4f {
    if shows_nothing(sum) {
        return vec4f(0.0);
    }
    let weight = select(sum.hit, sum.rays, batch.transparent_background != 0u);
    return vec4f(sum.color, sum.hit) / weight;
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
