// Computes level 1 of a pyramid from samples of level 0, which are computed on the fly and not stored.
// Comes after coverage_planes.wgsl and pyramid.wgsl.

// A sample of level 0: content and two more channels.
struct Sample {
    content: vec4f,
    rest: vec2f,
}

// The contributions of a row of fine samples to two neighbouring coarse samples.
struct Pair {
    left: Sample,
    right: Sample,
}

// Analysis filter: weighted sum of four samples along one axis.
fn analyzed(a: Sample, b: Sample, c: Sample, d: Sample) -> Sample {
    return Sample(
        level.inner * (b.content + c.content) + level.outer * (a.content + d.content),
        level.inner * (b.rest + c.rest) + level.outer * (a.rest + d.rest),
    );
}

// The two coarse samples among six fine samples in a row.
fn pair_of(a: Sample, b: Sample, c: Sample, d: Sample, e: Sample, f: Sample) -> Pair {
    return Pair(analyzed(a, b, c, d), analyzed(c, d, e, f));
}

fn four_rows(a: Pair, b: Pair, c: Pair, d: Pair) -> Pair {
    return Pair(analyzed(a.left, b.left, c.left, d.left), analyzed(a.right, b.right, c.right, d.right));
}

// 2 × 2 coarse samples, one column per channel.
struct Block {
    content: mat4x4f,
    rest: mat2x4f,
}

fn block_of(upper: Pair, lower: Pair) -> Block {
    let content = mat4x4f(upper.left.content, upper.right.content, lower.left.content, lower.right.content);
    let rest = mat4x2f(upper.left.rest, upper.right.rest, lower.left.rest, lower.right.rest);
    return Block(transpose(content), transpose(rest));
}

// Stores the content of 2 × 2 coarse samples, without those outside the pass's rows.
fn set_content(x: i32, y: i32, content: mat4x4f) {
    for (var k = 0; k < 3; k++) {
        set_coarse(k, x, y, content[k]);
    }
    if frame.channels > 3 {
        set_coarse(3, x, y, content[3]);
    }
}
