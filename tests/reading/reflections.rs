//! Channels of what surfaces reflect: by which names they are found, and what becomes of them.

use crate::fixtures::{Part, exr_bytes, source, stack_of};
use crate::{carried_names, warnings};
use exr::image::FlatSamples;
use thinlens::settings::AlphaMode;
use thinlens::stack::{ReadOptions, Shading, Source, Stack, read};

/// Names and values of a peel of colour 0.75, 0.5, 0.25, whose diffuse light is 0.25, 0.25, 0.125.
const PEEL: &str = "P.Combined.R=0.75 P.Combined.G=0.5 P.Combined.B=0.25 P.Combined.A=1 P.Depth.Z=4 \
                    P.Diffuse.R=0.25 P.Diffuse.G=0.25 P.Diffuse.B=0.125 P.Normal.X=0.6 P.Normal.Y=0 P.Normal.Z=0.8 \
                    P.ReflectedDistance.V=3";

/// [`PEEL`] called `name`, with `depth`.
fn peel(name: &str, depth: f32) -> String {
    PEEL.replace("P.", &format!("{name}.")).replace("Depth.Z=4", &format!("Depth.Z={depth}"))
}

fn shading_of(stack: &Stack, peel: usize) -> &Shading {
    stack.shading[peel].as_ref().unwrap_or_else(|| panic!("peel {peel}: {:?}", stack.findings))
}

/// `[light, normal, distance]` at the top left pixel.
fn first(shading: &Shading) -> ([f32; 3], [f32; 3], f32) {
    let of = |planes: &[thinlens::image::Plane; 3]| planes.each_ref().map(|plane| plane.get(0, 0));
    (of(&shading.light), of(&shading.normal), shading.reflected_distance.get(0, 0))
}

const FIRST: ([f32; 3], [f32; 3], f32) = ([0.5, 0.25, 0.125], [0.6, 0.0, 0.8], 3.0);

#[test]
fn reflections_are_found_by_every_name_and_in_any_case() {
    let root = |text: &str| text.replace("P.Combined.", "").replace("P.", "").replace("Depth.Z", "Z");
    for (case, channels) in [
        ("by peel", peel("Peel0", 4.0)),
        ("by view layer", peel("ViewLayer", 4.0)),
        (
            "of Mitsuba's peel",
            PEEL.replace("P.Combined.", "peel0.").replace("P.Depth.Z", "peel0.depth").replace("P.", "peel0."),
        ),
        ("at the root", root(PEEL)),
        ("distance Z", peel("Peel0", 4.0).replace("Distance.V", "Distance.Z")),
        ("distance Y", peel("Peel0", 4.0).replace("Distance.V", "Distance.Y")),
        ("distance alone", peel("Peel0", 4.0).replace("Distance.V", "Distance")),
        (
            "normal as a colour",
            peel("Peel0", 4.0)
                .replace("Normal.X", "Normal.R")
                .replace("Normal.Y", "Normal.G")
                .replace("Normal.Z", "Normal.B"),
        ),
        (
            "small letters",
            peel("Peel0", 4.0)
                .replace("Diffuse", "diffuse")
                .replace("Normal", "normal")
                .replace("ReflectedDistance.V", "reflecteddistance.v"),
        ),
        (
            "capitals",
            peel("Peel0", 4.0)
                .replace("Diffuse", "DIFFUSE")
                .replace("Normal", "NORMAL")
                .replace("ReflectedDistance", "REFLECTEDDISTANCE"),
        ),
        ("small peel", peel("peel0", 4.0).replace("Combined.", "")),
    ] {
        let stack = stack_of(vec![Part::flat((2, 1), &channels)]);
        assert_eq!((stack.peels.len(), stack.shading.len()), (1, 1), "{case}");
        assert!(stack.shading[0].is_some(), "{case}: {:?}", carried_names(&stack));
        assert_eq!(first(shading_of(&stack, 0)), FIRST, "{case}");
        assert!(warnings(&stack).is_empty(), "{case}: {:?}", warnings(&stack));
    }
}

#[test]
fn reflections_are_copied_to_the_output() {
    let stack = stack_of(vec![Part::flat((2, 1), &peel("Peel0", 4.0))]);
    let names = carried_names(&stack);
    for name in
        ["Diffuse.R", "Diffuse.G", "Diffuse.B", "Normal.X", "Normal.Y", "Normal.Z", "ReflectedDistance.V"]
    {
        assert!(names.contains(&format!("Peel0.{name}").as_str()), "{name}: {names:?}");
    }
    assert_eq!(names.len(), 7);
}

#[test]
fn reflections_of_blender_are_products_of_its_passes() {
    let passes = "Peel0.GlossDir.R=0.5 Peel0.GlossDir.G=0.25 Peel0.GlossDir.B=0 Peel0.GlossInd.R=0.5 Peel0.GlossInd.G=0.25 Peel0.GlossInd.B=1 \
                  Peel0.GlossCol.R=0.5 Peel0.GlossCol.G=0.5 Peel0.GlossCol.B=0.125 Peel0.ReflectedDistance.V=3";
    let without_diffuse: Vec<String> = peel("Peel0", 4.0)
        .split(' ')
        .filter(|channel| !channel.contains("Diffuse") && !channel.contains("Reflected"))
        .map(str::to_owned)
        .collect();
    let stack = stack_of(vec![Part::flat((2, 1), &format!("{} {passes}", without_diffuse.join(" ")))]);
    assert_eq!(first(shading_of(&stack, 0)), FIRST);
}

#[test]
fn peels_of_one_file_of_a_file_each_and_of_parts_have_their_own_reflections() {
    let far = |text: String| text.replace("Distance.V=3", "Distance.V=8");
    let (near, behind) = (peel("Peel0", 4.0), far(peel("Peel1", 6.0)));
    let root = |text: &str| {
        text.replace("Peel0.", "").replace("Peel1.", "").replace("Combined.", "").replace("Depth.Z", "Z")
    };
    let one = stack_of(vec![Part::flat((2, 1), &format!("{near} {behind}"))]);
    let files = [root(&near), root(&behind)].map(|channels| exr_bytes(vec![Part::flat((2, 1), &channels)]));
    let names = ["shot.peel0.exr", "shot.peel1.exr"];
    let sources: Vec<Source> =
        names.into_iter().zip(files).map(|(name, bytes)| Source::memory(name, bytes)).collect();
    let files = read(&sources, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}"));
    let parts = stack_of(vec![
        Part::flat((2, 1), &root(&near)).named("Peel0"),
        Part::flat((2, 1), &root(&behind)).named("Peel1"),
    ]);
    for (case, stack) in [("one file", one), ("files", files), ("parts", parts)] {
        assert_eq!(stack.shading.len(), 2, "{case}");
        let distances = [0, 1].map(|peel| first(shading_of(&stack, peel)).2);
        assert_eq!(distances, [3.0, 8.0], "{case}");
    }
}

#[test]
fn a_peel_without_channels_of_its_own_reflects_nothing() {
    let plain = "Peel1.Combined.R=1 Peel1.Combined.G=1 Peel1.Combined.B=1 Peel1.Combined.A=1 Peel1.Depth.Z=9";
    let stack = stack_of(vec![Part::flat((2, 1), &format!("{} {plain}", peel("Peel0", 4.0)))]);
    assert_eq!(stack.shading.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false]);
    let stack = stack_of(vec![Part::flat((2, 1), plain)]);
    assert!(stack.shading.is_empty());
    // Each of these alone is no reflection.
    for missing in ["Diffuse.G", "Normal.Y"] {
        let rest: Vec<String> = peel("Peel0", 4.0)
            .split(' ')
            .filter(|channel| !channel.contains(missing))
            .map(str::to_owned)
            .collect();
        assert!(stack_of(vec![Part::flat((2, 1), &rest.join(" "))]).shading.is_empty(), "without {missing}");
    }
}

#[test]
fn straight_light_is_multiplied_by_alpha() {
    let channels = peel("Peel0", 4.0).replace("Combined.A=1", "Combined.A=0.5");
    let options = ReadOptions { alpha: Some(AlphaMode::Straight), ..ReadOptions::default() };
    let stack = read(&[source(exr_bytes(vec![Part::flat((2, 1), &channels)]))], &options)
        .unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(first(shading_of(&stack, 0)).0, [0.25, 0.125, 0.0625]);
    assert_eq!(stack.peels[0].color[0].get(0, 0), 0.375);
}

#[test]
fn reflections_lie_where_their_data_window_is() {
    // The second peel is a pixel of its own, at column 2 of row 1.
    let at = Part::flat((1, 1), &peel("Peel1", 6.0)).named("b").at(2, 1);
    let stack = stack_of(vec![Part::flat((4, 2), &peel("Peel0", 4.0)).named("a"), at]);
    let shading = shading_of(&stack, 1);
    let lights: Vec<f32> = shading.light[0].values().to_vec();
    assert_eq!(lights, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0]);
    assert_eq!((shading.normal[2].get(2, 1), shading.reflected_distance.get(2, 1)), (0.8, 3.0));
    assert_eq!(shading.normal[2].get(0, 0), 0.0);
}

#[test]
fn without_a_distance_a_warning_says_that_all_is_far() {
    let channels = peel("Peel0", 4.0);
    let channels = channels.replace(" Peel0.ReflectedDistance.V=3", "");
    let stack = stack_of(vec![Part::flat((2, 1), &channels)]);
    assert_eq!(first(shading_of(&stack, 0)).2, f32::INFINITY);
    assert_eq!(warnings(&stack).len(), 1, "{:?}", warnings(&stack));
    assert!(warnings(&stack)[0].contains("no ReflectedDistance"), "{:?}", warnings(&stack));
}

#[test]
fn fragments_that_are_sorted_reflect_nothing_that_moves_and_a_note_says_how_many() {
    // In the right pixel the second peel is nearer.
    let part = Part::flat((2, 1), &format!("{} {}", peel("Peel0", 4.0), peel("Peel1", 6.0)))
        .with("Peel1.Depth.Z", FlatSamples::F32(vec![6.0, 2.0]));
    let stack = stack_of(vec![part]);
    let note = stack
        .findings
        .iter()
        .find(|finding| finding.about == "reflections")
        .unwrap_or_else(|| panic!("{:?}", stack.findings));
    assert!(!note.warning && note.text.starts_with("1 pixels reflect nothing"), "{}", note.text);
    for peel in [0, 1] {
        assert_eq!(shading_of(&stack, peel).light[0].values(), [0.5, 0.0], "peel {peel}");
        assert_eq!(shading_of(&stack, peel).normal[2].values(), [0.8, 0.0], "peel {peel}");
    }
}

#[test]
fn light_that_is_no_number_is_none() {
    for value in [f32::NAN, f32::INFINITY] {
        let part = Part::flat((2, 1), &peel("Peel0", 4.0))
            .with("Peel0.Diffuse.R", FlatSamples::F32(vec![value, 0.25]));
        let stack = stack_of(vec![part]);
        assert_eq!(shading_of(&stack, 0).light[0].values(), [0.0, 0.5], "{value}");
    }
}
