// What the rays of each pixel bring home, summed in goes; twin of `RaySum` in src/methods/mod.rs.
//
// resolve   the mean over all rays: sums to picture
//
// A go is some of the views. Its sum is made apart and added to those before: few additions each, so that single precision does.

// Some of the views of one set.
struct Batch {
    // From which view to before which.
    first_view: u32,
    end_view: u32,
    // Whether sums begin with this go.
    begins: u32,
    // Bit k is set where these views make channel k of the picture.
    channels: u32,
    // Whether light that finds nothing is transparent, and not left out of the mean.
    transparent_background: u32,
    // Pixels that are made.
    pixels: u32,
}

// What some rays bring home.
struct Sum {
    // Premultiplied colour.
    color: vec3f,
    // Rays that were stopped: parts of one where something translucent did.
    hit: f32,
    // Rays that count.
    rays: f32,
}

@group(0) @binding(0) var<uniform> go: Batch;
// [red, green, blue, hit, rays][row][column].
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;
// [red, green, blue, alpha][row][column].
@group(0) @binding(2) var<storage, read_write> picture: array<f32>;

// MIN_HIT, the share of rays that a pixel must have stopped to show anything, is the program's.

fn saved_sum(pixel: u32) -> Sum {
    let color = vec3f(sums[pixel], sums[go.pixels + pixel], sums[2u * go.pixels + pixel]);
    return Sum(color, sums[3u * go.pixels + pixel], sums[4u * go.pixels + pixel]);
}

fn save_sum(pixel: u32, sum: Sum) {
    sums[pixel] = sum.color.r;
    sums[go.pixels + pixel] = sum.color.g;
    sums[2u * go.pixels + pixel] = sum.color.b;
    sums[3u * go.pixels + pixel] = sum.hit;
    sums[4u * go.pixels + pixel] = sum.rays;
}

// Adds the sum of a go to those before.
fn add_go(pixel: u32, sum: Sum) {
    if go.begins != 0u {
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
    let weight = select(sum.hit, sum.rays, go.transparent_background != 0u);
    return vec4f(sum.color, sum.hit) / weight;
}

@compute @workgroup_size(64)
fn resolve(@builtin(workgroup_id) group: vec3u, @builtin(num_workgroups) groups: vec3u, @builtin(local_invocation_index) local: u32) {
    let pixel = (group.y * groups.x + group.x) * 64u + local;
    if pixel >= go.pixels {
        return;
    }
    let value = mean(saved_sum(pixel));
    for (var channel = 0u; channel < 4u; channel++) {
        if (go.channels >> channel & 1u) != 0u {
            picture[channel * go.pixels + pixel] = value[channel];
        }
    }
}
