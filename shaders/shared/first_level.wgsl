// Level 1 of a pyramid from samples of level 0, which are made where they are needed and not stored.
// Before it: covered.wgsl, pyramid.wgsl.

// A sample of level 0: content, and two more channels.
struct Sample {
    content: vec4f,
    rest: vec2f,
}

// Two coarse samples' parts of a row of fine ones.
struct Pair {
    left: Sample,
    right: Sample,
}

// Four samples in a row, or parts of four rows, weighed.
fn analysed(a: Sample, b: Sample, c: Sample, d: Sample) -> Sample {
    return Sample(
        level.inner * (b.content + c.content) + level.outer * (a.content + d.content),
        level.inner * (b.rest + c.rest) + level.outer * (a.rest + d.rest),
    );
}

// Of six samples in a row, the two coarse ones that lie among them.
fn pair_of(a: Sample, b: Sample, c: Sample, d: Sample, e: Sample, f: Sample) -> Pair {
    return Pair(analysed(a, b, c, d), analysed(c, d, e, f));
}

fn four_rows(a: Pair, b: Pair, c: Pair, d: Pair) -> Pair {
    return Pair(analysed(a.left, b.left, c.left, d.left), analysed(a.right, b.right, c.right, d.right));
}

// Two by two coarse samples, channel by channel.
struct Block {
    content: mat4x4f,
    rest: mat2x4f,
}

fn block_of(upper: Pair, lower: Pair) -> Block {
    let content = mat4x4f(upper.left.content, upper.right.content, lower.left.content, lower.right.content);
    let rest = mat4x2f(upper.left.rest, upper.right.rest, lower.left.rest, lower.right.rest);
    return Block(transpose(content), transpose(rest));
}

// Sets the content of two by two coarse samples, as far as they are to be made.
fn set_content(x: i32, y: i32, content: mat4x4f) {
    for (var k = 0; k < 3; k++) {
        set_coarse(k, x, y, content[k]);
    }
    if frame.channels > 3 {
        set_coarse(3, x, y, content[3]);
    }
}
