//! Windows: parts of a stack lie where their pixels are.

use super::fixtures::{Part, exr_bytes, exr_bytes_displayed, source};
use super::warnings;
use exr::image::FlatSamples;
use thinlens::error::ErrorKind;
use thinlens::image::{Image, Plane};
use thinlens::render::{Job, prepare_stack, render_stack};
use thinlens::settings::{DepthConvention, Effort, Focus, Values};
use thinlens::stack::{Frame, Peel, ReadOptions, Stack, Window, read};

/// Width and height of the frames.
const SIZE: (usize, usize) = (8, 6);

/// A part of `size` at `x, y`: opaque, of one colour and depth.
fn part(name: &'static str, (x, y): (i32, i32), size: (usize, usize), (color, depth): (f32, f32)) -> Part {
    Part::flat(size, &format!("R={color} G={color} B={color} A=1 Z={depth}")).named(name).at(x, y)
}

/// A part of the frame that is opaque in `window` only.
fn opaque_in(name: &'static str, window: Window, (color, depth): (f32, f32)) -> Part {
    let (width, height) = SIZE;
    let samples = |inside: f32, outside: f32| {
        let at = |i: usize| {
            let (x, y) = ((i % width) as i32 - window.x, (i / width) as i32 - window.y);
            let is_inside = (0..window.width as i32).contains(&x) && (0..window.height as i32).contains(&y);
            if is_inside { inside } else { outside }
        };
        FlatSamples::F32((0..width * height).map(at).collect())
    };
    let whole = part(name, (0, 0), SIZE, (color, depth));
    let colored = ["R", "G", "B"].into_iter().fold(whole, |part, name| part.with(name, samples(color, 0.0)));
    colored.with("A", samples(1.0, 0.0)).with("Z", samples(depth, f32::INFINITY))
}

/// A part of one empty pixel.
fn empty(name: &'static str, x: i32, y: i32) -> Part {
    Part::flat((1, 1), "R=0 G=0 B=0 A=0 Z=1e10").named(name).at(x, y)
}

/// What is seen without a lens, and where it lies.
fn seen(stack: Stack) -> (Window, Image) {
    let frame = stack.frame;
    let prepared = prepare_stack(stack, &sharp()).expect("it can be planned");
    (frame.data, prepared.scene.pinhole())
}

/// A job that blurs nothing.
fn sharp() -> Job {
    Job::default().with_values(Values {
        f_number: Some(f32::INFINITY),
        focus: Some(Focus::Distance(2.0)),
        ..Values::default()
    })
}

fn window(x: i32, y: i32, width: usize, height: usize) -> Window {
    Window { x, y, width, height }
}

#[test]
fn peels_cropped_to_what_they_show_are_those_of_the_whole_frame() {
    let crop = window(3, 1, 2, 3);
    let back = || part("peel1", (0, 0), SIZE, (0.2, 9.0));
    let cropped = stack_of_frame(vec![part("peel0", (3, 1), (2, 3), (0.7, 2.0)), back()]);
    let whole = stack_of_frame(vec![opaque_in("peel0", crop, (0.7, 2.0)), back()]);
    assert_eq!(cropped.frame, whole.frame);
    assert_eq!(cropped.peels, whole.peels);
    assert!(warnings(&cropped).is_empty(), "{:?}", warnings(&cropped));
    // Either of them may be the larger one, and neither may be.
    let apart = stack_of_frame(vec![
        part("peel0", (-2, 1), (3, 2), (0.7, 2.0)),
        part("peel1", (5, -1), (2, 4), (0.2, 9.0)),
    ]);
    assert_eq!(apart.frame.data, window(-2, -1, 9, 4));
    let alphas = apart.peels.iter().map(|peel| peel.alpha.values().iter().sum::<f32>());
    assert_eq!(alphas.collect::<Vec<_>>(), [6.0, 8.0]);
}

#[test]
fn an_empty_part_of_one_pixel_changes_nothing_wherever_it_lies() {
    let parts = |at: usize, pixel: (i32, i32)| {
        let names = ["peel0", "peel1", "peel2"];
        let mut others = [(0.7, 2.0), (0.2, 9.0)].into_iter();
        let made = names.into_iter().enumerate().map(|(i, name)| match others.next() {
            _ if i == at => empty(name, pixel.0, pixel.1),
            Some(content) => part(name, (0, 0), SIZE, content),
            None => part(name, (0, 0), SIZE, (0.2, 12.0)),
        });
        made.collect::<Vec<_>>()
    };
    let alone = seen(stack_of_frame(vec![part("peel0", (0, 0), SIZE, (0.7, 2.0))]));
    for pixel in [(0, 0), (7, 5), (3, 2), (-1, -1), (8, 6), (1 << 29, -(1 << 29))] {
        for at in 1..3 {
            let (data, image) = seen(stack_of_frame(parts(at, pixel)));
            assert_eq!(data, alone.0, "{pixel:?} as peel {at}");
            assert!(image == alone.1, "{pixel:?} as peel {at}");
        }
        let (data, image) = seen(stack_of_frame(parts(0, pixel)));
        assert_eq!(data, alone.0, "{pixel:?} first");
        assert_eq!(image.pixel(3, 2), [0.2, 0.2, 0.2, 1.0], "{pixel:?} first");
    }
}

#[test]
fn a_pixel_that_shows_something_counts_beside_the_frame_too() {
    let parts = vec![part("peel0", (0, 0), SIZE, (0.7, 2.0)), part("peel1", (8, 5), (1, 1), (0.2, 9.0))];
    let (data, image) = seen(stack_of_frame(parts));
    assert_eq!(data, window(0, 0, 9, 6));
    assert_eq!([image.pixel(8, 5), image.pixel(8, 4)], [[0.2, 0.2, 0.2, 1.0], [0.0; 4]]);
}

#[test]
fn peels_whose_common_window_does_not_fit_into_memory_are_refused_with_their_windows() {
    let far = 1 << 28;
    let parts = vec![part("peel0", (0, 0), SIZE, (0.7, 2.0)), part("peel1", (far, far), (2, 2), (0.2, 9.0))];
    let error =
        read(&[source(exr_bytes_displayed(parts, SIZE))], &ReadOptions::default()).expect_err("too far");
    assert_eq!(error.kind(), ErrorKind::Limits);
    assert!(error.to_string().contains("2×2 at (268435456, 268435456)"), "{error}");
}

#[test]
fn files_of_peels_are_joined_by_display_window() {
    let file = |parts: Vec<Part>| source(exr_bytes_displayed(parts, SIZE));
    let front = file(vec![part("a", (3, 1), (2, 3), (0.7, 2.0))]);
    let back = file(vec![part("b", (0, 0), SIZE, (0.2, 9.0))]);
    let stack = read(&[front, back.clone()], &ReadOptions::default()).expect("it is read");
    assert_eq!(stack.frame.data, window(0, 0, 8, 6));
    assert_eq!([stack.peels[0].depth.get(4, 3), stack.peels[0].depth.get(5, 3)], [2.0, f32::INFINITY]);
    let other = source(exr_bytes(vec![part("c", (0, 0), (4, 3), (0.1, 20.0))]));
    let stack = read(&[back, other], &ReadOptions::default()).expect("it is read");
    assert!(
        warnings(&stack).iter().any(|text| text.contains("differ in size, 8×6 at (0, 0) and 4×3 at (0, 0)"))
    );
}

#[test]
fn depth_of_another_data_window_lies_where_its_pixels_are_and_continues_at_its_edge() {
    let color = source(exr_bytes_displayed(vec![Part::flat(SIZE, "R=1 G=1 B=1 A=1")], SIZE));
    let ramp = (0..48).map(|i| (i % 8 + 1) as f32).collect();
    let moved = Part::flat(SIZE, "Z=0").with("Z", FlatSamples::F32(ramp)).at(-2, 0);
    let depth = source(exr_bytes_displayed(vec![moved], SIZE));
    let stack = read(&[color, depth], &ReadOptions::default()).expect("it is read");
    let row = stack.peels[0].depth.row(3);
    assert_eq!(row[..6], [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
    // The median of the six columns that are known there.
    assert!((5.0..=8.0).contains(&row[6]) && row[6] == row[7], "{row:?}");
    assert!(warnings(&stack).iter().any(|text| text.contains("none for 25.0 %")), "{:?}", warnings(&stack));
}

#[test]
fn a_depth_picture_without_windows_lies_on_the_frame_or_on_all_pixels_by_its_size() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("depth.png");
    let data = window(-2, -1, 12, 8);
    let color = exr_bytes_displayed(vec![Part::flat((12, 8), "R=1 G=1 B=1 A=1").at(data.x, data.y)], SIZE);
    let convention = Some(DepthConvention::Normalised);
    let first_depth = |size: (u32, u32)| -> Result<[f32; 2], thinlens::error::Error> {
        let picture = image::ImageBuffer::from_fn(size.0, size.1, |x, y| {
            image::Luma([if (x, y) == (0, 0) { 65535_u16 } else { 0 }])
        });
        picture.save(&file).expect("written");
        let options = ReadOptions { convention, depth_file: Some(file.clone()), ..ReadOptions::default() };
        let stack = read(&[source(color.clone())], &options)?;
        let depth = &stack.peels[0].depth;
        Ok([depth.get(0, 0), depth.get(2, 1)])
    };
    assert_eq!(first_depth((12, 8)).expect("all pixels"), [1.0, 0.0]);
    assert_eq!(first_depth((8, 6)).expect("the frame"), [0.0, 1.0]);
    let text = first_depth((6, 4)).expect_err("another size").to_string();
    assert!(text.contains("12×8 pixels at (-2, -1)") && text.contains("6×4 pixels at (0, 0)"), "{text}");
}

#[test]
fn other_channels_of_cropped_parts_are_copied_to_where_they_lie() {
    let parts = vec![
        part("peel0", (3, 1), (2, 3), (0.7, 2.0)),
        part("peel1", (0, 0), SIZE, (0.2, 9.0)),
        Part::flat((1, 2), "id=5").named("extra").at(2, 2),
        Part::flat((1, 2), "id=5").named("outside").at(-2, 2),
    ];
    let stack = stack_of_frame(parts);
    let [channel] = &stack.carried.channels[..] else { panic!("{:?}", super::carried_names(&stack)) };
    let FlatSamples::F32(samples) = &channel.samples else { panic!("another type") };
    let set: Vec<usize> = (0..samples.len()).filter(|&i| samples[i] == 5.0).collect();
    assert_eq!((channel.name.as_str(), set), ("extra.id", vec![2 * 8 + 2, 3 * 8 + 2]));
    assert!(warnings(&stack)[0].contains("1 channels have pixels outside"), "{:?}", warnings(&stack));
}

#[test]
fn default_focus_is_on_what_is_nearest_to_an_empty_centre_with_a_warning() {
    let focus = |parts: Vec<Part>| {
        let prepared =
            prepare_stack(stack_of_frame(parts), &Job::default()).map_err(|error| error.to_string())?;
        let warned = warnings(&prepared.stack).iter().any(|text| text.contains("nothing is at the centre"));
        Ok::<_, String>((prepared.lens.focus_distance, warned))
    };
    let aside = part("peel0", (0, 0), (3, 3), (0.7, 2.0));
    assert_eq!(focus(vec![aside]), Ok((2.0, true)), "content that has left the middle");
    let two = vec![part("peel0", (0, 0), (2, 6), (0.7, 2.0)), part("peel1", (6, 0), (2, 6), (0.7, 5.0))];
    assert_eq!(focus(two), Ok((2.0, true)), "of two as near, the one to the left");
    let nearer = vec![part("peel0", (0, 0), (1, 6), (0.7, 2.0)), part("peel1", (6, 0), (2, 6), (0.7, 5.0))];
    assert_eq!(focus(nearer), Ok((5.0, true)));
    assert_eq!(focus(vec![part("peel0", (0, 0), SIZE, (0.7, 3.0))]), Ok((3.0, false)));
    let sky = vec![Part::flat(SIZE, "R=1 G=1 B=1 A=1 Z=1e10")];
    assert!(focus(sky).is_err_and(|text| text.contains("only background in the picture")));
}

#[test]
fn a_blurred_point_is_round_when_pixels_that_are_not_square_are_shown() {
    const SIDE: usize = 61;
    for (method, aspect) in
        [("shear", 2.0), ("accumulate", 2.0), ("shear", 0.5), ("accumulate", 0.5), ("peel-rays", 0.5)]
    {
        let centre = |x: usize, y: usize| if (x, y) == (SIDE / 2, SIDE / 2) { 1.0 } else { 0.0 };
        let light = Plane::from_fn(SIDE, SIDE, centre);
        let peel = Peel {
            color: [light.clone(), light.clone(), light],
            alpha: Plane::filled(SIDE, SIDE, 1.0),
            depth: Plane::filled(SIDE, SIDE, 4.0),
        };
        let frame = Frame { pixel_aspect: aspect, ..Frame::from_size(SIDE, SIDE) };
        let stack = Stack::from_peels(vec![peel], frame, &ReadOptions::default()).expect("a stack");
        let values = Values {
            focus: Some(Focus::Distance(2.0)),
            focal_length_mm: Some(50.0),
            // A CoC radius of 10 widths of a pixel for aspect 1/2, and of 5 for aspect 2: 10 px across or down.
            f_number: Some(0.5 * 0.05 / 2.0 * 0.5 * 0.05 / 0.036 * SIDE as f32 / 10.0 * aspect.max(1.0)),
            method: Some(method.to_owned()),
            effort: Some(Effort::Views(1024)),
            ..Values::default()
        };
        let rendered =
            render_stack(stack, &Job::default().with_values(values), &|_| {}).expect("it is rendered");
        let spot = &rendered.image.planes[1];
        let moment = |place: fn(usize, usize) -> usize| {
            let sum = |f: &dyn Fn(usize, usize) -> f64| {
                (0..SIDE * SIDE).map(|i| f(i % SIDE, i / SIDE)).sum::<f64>()
            };
            let light = sum(&|x, y| f64::from(spot.get(x, y)));
            sum(&|x, y| f64::from(spot.get(x, y)) * (place(x, y) as f64 - 30.0).powi(2)) / light
        };
        // A disc's second moment is a quarter of its squared radius; a pixel adds a twelfth.
        let [across, down] =
            [moment(|x, _| x), moment(|_, y| y)].map(|moment| 2.0 * (moment - 1.0 / 12.0).sqrt());
        let shown = down / across / f64::from(aspect);
        assert!((shown - 1.0).abs() < 0.03, "{method}, {aspect}: {across:.2} across, {down:.2} down");
        assert!(
            (across.max(down) - 10.0).abs() < 0.5,
            "{method}, {aspect}: {across:.2} across, {down:.2} down"
        );
    }
}

#[test]
fn a_method_that_takes_pixels_for_square_says_so_where_they_are_not() {
    let said = |method: &str, aspect: f32| {
        let plane = |value| Plane::filled(16, 16, value);
        let peel = Peel { color: [plane(0.5), plane(0.5), plane(0.5)], alpha: plane(1.0), depth: plane(4.0) };
        let frame = Frame { pixel_aspect: aspect, ..Frame::from_size(16, 16) };
        let stack = Stack::from_peels(vec![peel], frame, &ReadOptions::default()).expect("a stack");
        let values = Values {
            focus: Some(Focus::Distance(2.0)),
            f_number: Some(0.5),
            method: Some(method.to_owned()),
            ..Values::default()
        };
        let prepared = prepare_stack(stack, &Job::default().with_values(values)).expect("it can be planned");
        warnings(&prepared.stack).iter().any(|text| text.contains("as if pixels were square"))
    };
    assert!(said("gather", 2.0) && !said("gather", 1.0) && !said("shear", 2.0));
}

#[test]
fn a_pixel_aspect_that_no_picture_has_is_said_and_pixels_are_square() {
    let said = |aspect: f32| {
        let plane = |value| Plane::filled(2, 2, value);
        let peel = Peel { color: [plane(0.5), plane(0.5), plane(0.5)], alpha: plane(1.0), depth: plane(4.0) };
        let frame = Frame { pixel_aspect: aspect, ..Frame::from_size(2, 2) };
        let stack = Stack::from_peels(vec![peel], frame, &ReadOptions::default()).expect("a stack");
        let about = stack.findings.iter().find(|finding| finding.about == "frame");
        about.map(|finding| (finding.warning, finding.text.clone()))
    };
    assert_eq!(said(1.0), None);
    assert!(said(2.0).is_some_and(|(warns, text)| !warns && text.contains("2 times as wide as high")));
    for aspect in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e6] {
        assert!(
            said(aspect).is_some_and(|(warns, text)| warns && text.contains("treated as square")),
            "{aspect}"
        );
    }
}

/// A stack of `parts` whose display window is the frame.
fn stack_of_frame(parts: Vec<Part>) -> Stack {
    read(&[source(exr_bytes_displayed(parts, SIZE))], &ReadOptions::default())
        .unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn an_empty_part_needs_no_depth_and_a_crop_of_several_samples_a_pixel_no_whole_pixels() {
    let no_depth = Part::flat((1, 1), "R=0 G=0 B=0 A=0").named("peel0");
    let stack = stack_of_frame(vec![no_depth, part("peel1", (0, 0), SIZE, (0.2, 9.0))]);
    assert_eq!((stack.peels.len(), stack.frame.data), (2, window(0, 0, 8, 6)));
    let parts = vec![part("peel0", (3, 1), (2, 2), (0.7, 2.0)), part("peel1", (4, 2), (1, 2), (0.2, 9.0))];
    let options = ReadOptions { supersample: Some(2), ..ReadOptions::default() };
    let stack = read(&[source(exr_bytes_displayed(parts, SIZE))], &options).expect("it is read");
    assert_eq!(stack.frame.data, window(2, 0, 4, 4));
    assert_eq!(stack.peels[0].alpha.row(1), [0.0, 1.0, 1.0, 0.0]);
}

#[test]
fn depth_that_shares_no_pixel_with_the_colour_is_refused() {
    let color = source(exr_bytes_displayed(vec![Part::flat(SIZE, "R=1 G=1 B=1 A=1")], SIZE));
    let depth = source(exr_bytes_displayed(vec![Part::flat((2, 2), "Z=4").at(20, 0)], SIZE));
    let error = read(&[color, depth], &ReadOptions::default()).expect_err("it lies elsewhere");
    assert!(error.to_string().contains("no pixel in common"), "{error}");
}
