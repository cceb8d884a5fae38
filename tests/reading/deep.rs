//! Deep files: every way to store them, volumes, several files of one picture, and what is damaged.

use super::deep_fixtures::{DeepPart, NONE, RLE, ZIP, ZIPS, deep_bytes, fog, grey};
use super::fixtures::{Part, exr_bytes, exr_bytes_displayed, failure, failure_with, source};
use super::{first_pixels, warnings};
use exr::image::FlatSamples;
use std::slice::from_ref;
use thinlens::error::ErrorKind;
use thinlens::render::{Job, render};
use thinlens::settings::{Effort, Values};
use thinlens::stack::{ReadOptions, Source, Stack, Window, footprint, is_complete, read};

fn deep(parts: &[DeepPart]) -> Source {
    source(deep_bytes(parts))
}

fn stack_of(sources: &[Source]) -> Stack {
    read(sources, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// Colour and alpha of the picture that a closed lens takes, at the top left pixel.
fn seen(sources: Vec<Source>) -> [f32; 2] {
    let values =
        Values { f_number: Some(f32::INFINITY), effort: Some(Effort::Views(1)), ..Values::default() };
    let image = render(&Job::new(sources).with_values(values), &|_| {}).expect("a picture").image;
    [image.planes[0].get(0, 0), image.planes[3].get(0, 0)]
}

/// Samples in no order, of which pixels have from 0 to 3.
fn scene(x: i32, y: i32) -> Vec<Vec<f32>> {
    let count = (x + y) % 4;
    (0..count)
        .map(|i| grey(9.0 - i as f32 - 0.125 * x as f32, 0.25 * (1 + i) as f32 / 4.0, 0.25 + 0.25 * i as f32))
        .collect()
}

#[test]
fn every_codec_in_rows_and_in_tiles_stores_the_same_samples() {
    let part = DeepPart::surfaces(21, 19, scene);
    let expected = stack_of(&[deep(&[DeepPart { codec: NONE, ..part.clone() }])]);
    assert_eq!(expected.peels.len(), 3);
    for codec in [NONE, RLE, ZIPS, ZIP] {
        for tile in [None, Some([8, 8]), Some([5, 64]), Some([64, 3])] {
            let stack = stack_of(&[deep(&[DeepPart { codec, tile, ..part.clone() }])]);
            assert_eq!(stack.peels, expected.peels, "codec {codec}, tiles {tile:?}");
        }
    }
}

#[test]
fn the_samples_of_a_pixel_are_sorted_nearest_first() {
    let stack = stack_of(&[deep(&[DeepPart::surfaces(21, 19, scene)])]);
    // Pixel (3, 0) has three samples, the farthest first in the file.
    let depths: Vec<f32> = stack.peels.iter().map(|peel| peel.depth.get(3, 0)).collect();
    assert_eq!(depths, [6.625, 7.625, 8.625]);
    let alphas: Vec<f32> = stack.peels.iter().map(|peel| peel.alpha.get(1, 0)).collect();
    assert_eq!(alphas, [0.25, 0.0, 0.0], "a pixel with one");
    assert!(stack.findings.iter().any(|finding| finding.text.contains("at most 3 a pixel")));
}

#[test]
fn files_of_one_picture_are_merged_by_depth_in_any_order() {
    let near = DeepPart {
        window: [2, 1, 3, 2],
        display: [8, 6],
        ..DeepPart::surfaces(3, 2, |_, _| vec![grey(2.0, 0.1, 0.5)])
    };
    let far = DeepPart {
        window: [0, 0, 8, 6],
        display: [8, 6],
        ..DeepPart::surfaces(8, 6, |_, _| vec![grey(7.0, 0.4, 1.0), grey(1.0, 0.0, 0.25)])
    };
    let stack = stack_of(&[deep(from_ref(&near)), deep(from_ref(&far))]);
    assert_eq!(stack.frame.data, Window { x: 0, y: 0, width: 8, height: 6 }, "the windows together");
    let at = |x: usize, y: usize| stack.peels.iter().map(|peel| peel.depth.get(x, y)).collect::<Vec<f32>>();
    assert_eq!(at(2, 1), [1.0, 2.0, 7.0]);
    assert_eq!(at(5, 1), [1.0, 7.0, f32::INFINITY], "beside the first file's window");
    assert_eq!(stack_of(&[deep(&[far]), deep(&[near])]).peels, stack.peels);
    assert!(warnings(&stack).is_empty(), "{:?}", stack.findings);
}

#[test]
fn parts_of_one_file_are_merged_as_files_are() {
    let [near, far] = [2.0, 5.0].map(|z| DeepPart::surfaces(4, 3, move |_, _| vec![grey(z, 0.1 * z, 0.5)]));
    let files = stack_of(&[deep(from_ref(&near)), deep(from_ref(&far))]);
    let parts = stack_of(&[deep(&[DeepPart { name: "far", ..far }, DeepPart { name: "near", ..near }])]);
    assert_eq!(parts.peels, files.peels);
}

#[test]
fn of_two_eyes_one_is_chosen_by_name_and_without_a_name_the_error_names_both() {
    let eye = |view: &'static str, z: f32| DeepPart {
        name: view,
        view: Some(view),
        ..DeepPart::surfaces(4, 3, move |_, _| vec![grey(z, 0.5, 1.0)])
    };
    let both = || deep(&[eye("left", 2.0), eye("right", 3.0)]);
    let of_view = |view: Option<&str>| {
        let options = ReadOptions { view: view.map(str::to_owned), ..ReadOptions::default() };
        read(&[both()], &options)
    };
    for (view, depth) in [("left", 2.0), ("right", 3.0)] {
        let stack = of_view(Some(view)).unwrap();
        assert_eq!((stack.peels.len(), stack.peels[0].depth.get(0, 0)), (1, depth), "{view}");
    }
    let error = of_view(None).unwrap_err().to_string();
    assert!(error.contains("left") && error.contains("right") && error.contains("`view"), "{error}");
}

#[test]
fn two_volumes_that_overlap_keep_their_light_and_their_shadow() {
    // Fog of one kind in 2 … 6 and 4 … 8: every metre emits the same and lets 0.8 of the light pass.
    let alpha = 1.0 - 0.8_f32.powi(4);
    let of =
        |front: f32| DeepPart::volumes(2, 2, move |_, _| vec![fog(front, front + 4.0, 0.5 * alpha, alpha)]);
    let expected = 1.0 - 0.8_f32.powi(8);
    let [color, seen_alpha] = seen(vec![deep(&[of(2.0)]), deep(&[of(4.0)])]);
    assert!(
        (seen_alpha - expected).abs() < 1e-6 && (color - 0.5 * expected).abs() < 1e-6,
        "{color} {seen_alpha}"
    );
    // In one file, as two samples of a pixel, it is the same.
    let both = DeepPart::volumes(2, 2, |_, _| {
        vec![fog(4.0, 8.0, 0.5 * alpha, alpha), fog(2.0, 6.0, 0.5 * alpha, alpha)]
    });
    let [color, seen_alpha] = seen(vec![deep(&[both])]);
    assert!(
        (seen_alpha - expected).abs() < 1e-6 && (color - 0.5 * expected).abs() < 1e-6,
        "{color} {seen_alpha}"
    );
}

#[test]
fn a_surface_in_fog_is_seen_through_the_part_before_it() {
    let alpha = 1.0 - 0.5_f32.powi(4);
    let pixel = move |_, _| vec![fog(1.0, 5.0, 0.0, alpha), fog(2.0, 2.0, 0.8, 1.0)];
    let [color, seen_alpha] = seen(vec![deep(&[DeepPart::volumes(2, 2, pixel)])]);
    assert!(
        (color - 0.4).abs() < 1e-6 && (seen_alpha - 1.0).abs() < 1e-6,
        "a quarter of the fog lets half pass: {color}"
    );
}

#[test]
fn of_more_samples_than_peels_the_picture_is_the_same() {
    let pixel = |_, _| (0..60).map(|i| grey(2.0 + 0.25 * i as f32, 0.02 * (i % 7) as f32, 0.05)).collect();
    let part = DeepPart::surfaces(3, 2, pixel);
    let stack = stack_of(&[deep(from_ref(&part))]);
    assert_eq!(stack.peels.len(), 16);
    assert!(
        stack.findings.iter().any(|finding| finding.text.contains("in 6 pixels")),
        "{:?}",
        stack.findings
    );
    let (mut color, mut passing) = (0.0, 1.0);
    for i in 0..60 {
        color += passing * 0.02 * f64::from(i % 7);
        passing *= 0.95;
    }
    let [seen_color, alpha] = seen(vec![deep(&[part])]);
    assert!(
        (f64::from(seen_color) - color).abs() < 1e-5 && (f64::from(alpha) - (1.0 - passing)).abs() < 1e-5
    );
}

#[test]
fn rows_of_a_deep_file_are_those_of_the_whole() {
    let part = DeepPart { window: [-3, 5, 7, 70], display: [64, 80], ..DeepPart::surfaces(7, 70, scene) };
    for (codec, tile) in [(ZIPS, None), (ZIP, None), (ZIP, Some([4, 24]))] {
        let files = [deep(&[DeepPart { codec, tile, ..part.clone() }])];
        let whole = stack_of(&files);
        let options = ReadOptions { rows: Some(30..47), ..ReadOptions::default() };
        let rows = read(&files, &options).unwrap();
        assert_eq!(rows.frame.data, Window { x: -3, y: 30, width: 7, height: 17 });
        for (rows, whole) in rows.peels.iter().zip(&whole.peels) {
            assert_eq!(rows.color[0].row(0), whole.color[0].row(25), "{codec} {tile:?}");
            assert_eq!(rows.alpha.row(16), whole.alpha.row(41), "{codec} {tile:?}");
        }
    }
}

#[test]
fn the_memory_of_a_deep_file_follows_from_its_tables() {
    let files = [deep(&[DeepPart::surfaces(40, 30, scene)])];
    let found = footprint(&files, &ReadOptions::default()).unwrap();
    assert_eq!((found.width, found.height, found.peels, found.sample_bytes), (40, 30, 3, 60));
    assert!(found.is_in_rows);
    let limit = |max_bytes| ReadOptions { max_bytes: Some(max_bytes), ..ReadOptions::default() };
    assert!(read(&files, &limit(found.decoded_bytes() + 24 * 3 * 40 * 32)).is_ok());
    let error = read(&files, &limit(40 * 30 * 60 - 1)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Limits, "{error}");
}

#[test]
fn flat_stacks_are_merged_by_depth_if_the_user_says_so() {
    let picture = |z: f32, alpha: f32| {
        let channels = format!("R=0.25 G=0.25 B=0.25 A={alpha} Z={z}");
        source(exr_bytes_displayed(vec![Part::flat((4, 3), &channels)], (4, 3)))
    };
    let merge = ReadOptions { merge: true, ..ReadOptions::default() };
    let files = [picture(5.0, 1.0), picture(2.0, 0.5)];
    let stack = read(&files, &merge).unwrap();
    assert_eq!(first_pixels(&stack).iter().map(|pixel| pixel[4]).collect::<Vec<_>>(), [2.0, 5.0]);
    assert!(warnings(&stack).is_empty(), "{:?}", stack.findings);
    let turned = [files[1].clone(), files[0].clone()];
    assert_eq!(read(&turned, &merge).unwrap().peels, stack.peels);
    // A deep file among them is enough.
    let with_deep = [files[0].clone(), deep(&[DeepPart::surfaces(4, 3, |_, _| vec![grey(2.0, 0.25, 0.5)])])];
    assert_eq!(stack_of(&with_deep).peels, stack.peels);
}

#[test]
fn an_element_may_be_cropped_to_a_pixel_anywhere() {
    let whole = source(exr_bytes_displayed(vec![Part::flat((8, 6), "R=0.5 G=0.5 B=0.5 A=1 Z=4")], (8, 6)));
    let merge = ReadOptions { merge: true, ..ReadOptions::default() };
    for (x, y) in [(3, 2), (0, 0), (-7, 20)] {
        let dot = exr_bytes_displayed(vec![Part::flat((1, 1), "R=1 G=1 B=1 A=1 Z=2").at(x, y)], (8, 6));
        let stack = read(&[whole.clone(), source(dot)], &merge).unwrap();
        let data = stack.frame.data;
        assert!(data.contains(Window { x, y, width: 1, height: 1 }));
        let [column, row] = [(x - data.x) as usize, (y - data.y) as usize];
        assert_eq!(stack.peels[0].depth.get(column, row), 2.0);
        let origin = [(-data.x) as usize + 7, (-data.y) as usize + 5];
        assert_eq!(stack.peels[0].depth.get(origin[0], origin[1]), 4.0, "the whole element is where it was");
    }
}

#[test]
fn what_is_no_element_is_refused_with_what_to_do() {
    let refused = |sources: &[Source], options: &ReadOptions| read(sources, options).unwrap_err().to_string();
    let merge = ReadOptions { merge: true, ..ReadOptions::default() };
    let flat = |channels: &str, size| source(exr_bytes(vec![Part::flat(size, channels)]));
    let with_depth = "R=1 G=1 B=1 A=1 Z=2";
    let text = refused(&[flat(with_depth, (2, 2)), flat("R=1 G=1 B=1 A=1", (2, 2))], &merge);
    assert!(text.contains("no depth channel"), "{text}");
    let text = refused(&[flat(with_depth, (2, 2)), flat(with_depth, (3, 2))], &merge);
    assert!(text.contains("display window") && text.contains("3×2"), "{text}");
    let ray = "R=1 G=1 B=1 A=1 depth.T=2";
    let text = refused(&[flat(with_depth, (2, 2)), flat(ray, (2, 2))], &merge);
    assert!(text.contains("`convention`"), "{text}");
    let with_file = ReadOptions { depth_file: Some("depth.exr".into()), ..merge };
    assert!(refused(&[flat(with_depth, (2, 2))], &with_file).contains("`depth_file`"));
    let shadow =
        DeepPart { channels: vec!["A", "Z"], ..DeepPart::surfaces(2, 2, |_, _| vec![vec![1.0, 2.0]]) };
    assert!(failure(deep_bytes(&[shadow])).to_string().contains("no colour channels"));
    let without_depth = DeepPart {
        channels: vec!["A", "B", "G", "R"],
        ..DeepPart::surfaces(2, 2, |_, _| vec![vec![1.0; 4]])
    };
    assert!(failure(deep_bytes(&[without_depth])).to_string().contains("no depth channel"));
    let piz = DeepPart { codec: 4, ..DeepPart::surfaces(2, 2, scene) };
    assert_eq!(failure(deep_bytes(&[piz])).kind(), ErrorKind::Unsupported);
}

#[test]
fn a_deep_file_that_is_cut_short_is_an_error_wherever_it_ends() {
    for codec in [NONE, RLE, ZIP] {
        let whole = deep_bytes(&[DeepPart { codec, ..DeepPart::surfaces(5, 18, scene) }]);
        assert!(is_complete(&source(whole.clone())).unwrap());
        for length in (8..whole.len()).step_by(7) {
            let error = failure(whole[..length].to_vec());
            assert!(matches!(error.kind(), ErrorKind::Input | ErrorKind::Read), "{length}: {error}");
        }
    }
}

#[test]
fn any_changed_byte_is_a_picture_or_an_error() {
    let parts = [
        DeepPart { codec: ZIP, ..DeepPart::surfaces(5, 18, scene) },
        DeepPart {
            tile: Some([4, 4]),
            codec: RLE,
            ..DeepPart::volumes(6, 6, |_, _| vec![fog(1.0, 3.0, 0.5, 0.5)])
        },
    ];
    let options = ReadOptions { max_bytes: Some(1 << 24), ..ReadOptions::default() };
    for part in parts {
        let whole = deep_bytes(&[part]);
        for place in 8..whole.len() {
            for value in [0xff, whole[place] ^ 0x80] {
                let mut changed = whole.clone();
                changed[place] = value;
                drop(read(&[source(changed)], &options));
            }
        }
    }
}

#[test]
fn a_header_that_claims_more_than_the_file_has_is_refused() {
    let part = DeepPart::surfaces(4, 4, scene);
    let huge = DeepPart { window: [0, 0, 4, 4], ..part };
    let mut bytes = deep_bytes(&[huge]);
    let at = bytes.windows(11).position(|name| name == b"dataWindow\0").unwrap() + 11 + 6 + 4;
    bytes[at + 8..at + 16].copy_from_slice(&[0xff, 0xff, 0xff, 0x1f, 0xff, 0xff, 0xff, 0x1f]);
    let error = failure_with(bytes, &ReadOptions::default());
    assert_eq!(error.kind(), ErrorKind::Input, "{error}");
}

#[test]
fn the_edges_of_a_flat_element_get_their_depth_before_it_is_merged() {
    // A card whose rim has a quarter of the pixel and the depth of the background, over a wall.
    let row = |inside: f32, rim: f32, outside: f32| {
        let place = |x: usize| {
            if (4..8).contains(&x) {
                inside
            } else if x == 3 || x == 8 {
                rim
            } else {
                outside
            }
        };
        FlatSamples::F32((0..12 * 6).map(|i| place(i % 12)).collect())
    };
    let card = Part::flat((12, 6), "R=0 G=0 B=0 A=0 Z=0")
        .with("R", row(0.5, 0.125, 0.0))
        .with("A", row(1.0, 0.25, 0.0))
        .with("Z", row(2.0, 1e10, 1e10));
    let wall = Part::flat((12, 6), "R=0.25 G=0.25 B=0.25 A=1 Z=9");
    let merge = ReadOptions { merge: true, ..ReadOptions::default() };
    let stack = read(&[source(exr_bytes(vec![wall])), source(exr_bytes(vec![card]))], &merge).unwrap();
    let depths = |peel: usize| [3, 5, 8].map(|x| stack.peels[peel].depth.get(x, 3));
    assert_eq!([depths(0), depths(1)], [[2.0; 3], [9.0; 3]]);
}

#[test]
fn negative_depth_of_deep_samples_is_the_distance_along_an_axis_that_points_backwards() {
    let [before, behind] = [1.0, -1.0].map(|sign| {
        DeepPart::volumes(3, 2, move |_, _| {
            vec![fog(sign * 2.0, sign * 4.0, 0.2, 0.5), fog(sign * 3.0, sign * 3.0, 0.1, 1.0)]
        })
    });
    assert_eq!(stack_of(&[deep(&[behind])]).peels, stack_of(&[deep(&[before])]).peels);
}

#[test]
fn deep_samples_without_alpha_are_opaque_and_said_to_be() {
    let part = DeepPart::surfaces(2, 2, |_, _| vec![vec![0.5, 0.5, 0.5, 3.0], vec![0.25, 0.25, 0.25, 2.0]]);
    let stack = stack_of(&[deep(&[DeepPart { channels: vec!["B", "G", "R", "Z"], ..part }])]);
    assert_eq!(first_pixels(&stack), [[0.25, 0.25, 0.25, 1.0, 2.0], [0.5, 0.5, 0.5, 1.0, 3.0]]);
    assert!(warnings(&stack).iter().any(|text| text.contains("no channel A")), "{:?}", stack.findings);
}

#[test]
fn a_deep_file_is_read_as_the_flat_stack_of_its_samples() {
    let (width, height) = (21, 19);
    let mut part = Part::flat((width, height), "carried=1");
    for peel in 0..3 {
        for (channel, name) in ["A", "B", "G", "R", "Z"].into_iter().enumerate() {
            let value = |i: usize| {
                let mut samples = scene((i % width) as i32, (i / width) as i32);
                samples.sort_by(|a, b| a[4].total_cmp(&b[4]));
                samples
                    .get(peel)
                    .map_or(if name == "Z" { f32::INFINITY } else { 0.0 }, |sample| sample[channel])
            };
            let values = (0..width * height).map(value).collect();
            part = part.with(&format!("peel{peel}.{name}"), FlatSamples::F32(values));
        }
    }
    let flat = stack_of(&[source(exr_bytes(vec![part]))]);
    let stack = stack_of(&[deep(&[DeepPart::surfaces(width as i32, height as i32, scene)])]);
    assert_eq!(stack.peels, flat.peels);
    assert_eq!((stack.kind, stack.antialiasing), (flat.kind, flat.antialiasing));
}
