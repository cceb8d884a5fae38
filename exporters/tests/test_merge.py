"""Merging against closed forms: from what a pixel's samples show follow alpha, colour and depth of its layers."""

import unittest

import numpy as np

from thinlens_stack.errors import ExportError
from thinlens_stack.lens import Lens
from thinlens_stack.merge import Layer, interleave, merge, split, stacked

# In a picture 1000 pixels wide, the CoC radius is 10 px at infinity, 0 at 1 and -10 px at 0.5.
WIDTH_PX = 1000
LENS = Lens(focal_length_mm=10.0, sensor_width_mm=10.0, f_number=0.5, focus_distance=1.0)
SKY = 1e10


def depth_at(coc_px: float) -> float:
    """The depth at which the CoC radius is `coc_px`."""
    return 1.0 / (1.0 - coc_px / 10.0)


def pixel(samples: list[list[tuple[float, float, float]]]) -> list[list[Layer]]:
    """The phases of one pixel: for each sample its fragments `(premultiplied colour, alpha, depth)`, nearest first."""
    peels = max(map(len, samples))

    def layer(color, alpha, depth):
        color, alpha, depth = (np.full((1, 1), value, np.float32) for value in (color, alpha, depth))
        return Layer(np.stack([color] * 3, axis=-1), alpha, depth, {"Diffuse.R": color / 2}, {"Normal.X": depth * 3})

    return [[layer(*fragment) for fragment in sample + [(0, 0, SKY)] * (peels - len(sample))] for sample in samples]


def merged(samples) -> list[tuple[float, float, float]]:
    """The fragments `(colour, alpha, depth)` of the merged pixel."""
    layers = merge(pixel(samples), LENS, WIDTH_PX)
    return [(float(x.color[0, 0, 0]), float(x.alpha[0, 0]), float(x.depth[0, 0])) for x in layers]


class Surfaces(unittest.TestCase):
    def assert_fragments(self, found, expected):
        np.testing.assert_allclose(found, expected, rtol=1e-5)

    def test_one_surface_is_opaque_with_the_mean_colour_and_the_harmonic_mean_of_depth(self):
        depths = [depth_at(2.0 + 0.1 * i) for i in range(4)]
        found = merged([[(i, 1.0, depth)] for i, depth in enumerate(depths)])
        self.assert_fragments(found, [(1.5, 1.0, 4.0 / sum(1.0 / depth for depth in depths))])

    def test_an_edge_becomes_coverage_over_the_surface_behind(self):
        near, far = depth_at(-5.0), depth_at(4.0)
        found = merged([[(1.0, 1.0, near)], *[[(0.5, 1.0, far)]] * 3])
        self.assert_fragments(found, [(0.25, 0.25, near), (0.375, 0.75, far)])

    def test_a_surface_that_is_the_first_of_one_sample_and_the_second_of_another_is_one(self):
        near, far = depth_at(-5.0), depth_at(4.0)
        found = merged([[(1.0, 1.0, near), (0.5, 1.0, far)], *[[(0.5, 1.0, far)]] * 3])
        self.assert_fragments(found, [(0.25, 0.25, near), (0.5, 1.0, far)])

    def test_two_fragments_of_one_sample_are_two_surfaces_however_near(self):
        near, far = depth_at(3.0), depth_at(3.1)
        self.assert_fragments(merged([[(1.0, 1.0, near), (0.0, 1.0, far)]]), [(1.0, 1.0, near), (0.0, 1.0, far)])

    def test_a_gap_parts_surfaces_and_a_slope_is_parted_at_twice_the_gap(self):
        at = [depth_at(0.45 * i) for i in range(4)]
        found = merged([[(1.0, 1.0, depth)] for depth in at])
        self.assertEqual([alpha for _, alpha, _ in found], [0.75, 0.25], "0.9 px in all, then the rest")
        apart = merged([[(1.0, 1.0, depth_at(0.0))]] * 2 + [[(1.0, 1.0, depth_at(0.55))]] * 2)
        self.assertEqual([alpha for _, alpha, _ in apart], [0.5, 0.5])

    def test_glass_is_a_surface_of_its_alpha(self):
        glass, wall = (0.2, 0.5, depth_at(-3.0)), (1.0, 1.0, depth_at(4.0))
        self.assert_fragments(merged([[glass, wall]] * 4), [glass, wall])

    def test_further_channels_are_summed_or_averaged(self):
        near, far = depth_at(-5.0), depth_at(4.0)
        layers = merge(pixel([[(1.0, 1.0, near)], *[[(0.5, 1.0, far)]] * 3]), LENS, WIDTH_PX)
        self.assertAlmostEqual(float(layers[1].sums["Diffuse.R"][0, 0]), 0.1875, places=6)
        self.assertAlmostEqual(float(layers[1].means["Normal.X"][0, 0]), 3.0 * far, places=5)


class TooMany(unittest.TestCase):
    def test_the_least_visible_is_dropped(self):
        # One peel keeps three layers. The second surface passes 1 - 0.9/2; of it the third shows a quarter, the
        # fourth as well.
        cocs = [-9.0, -4.0, 0.0, 5.0]
        samples = [[(1.0, 1.0, depth_at(coc))] for coc in (cocs[0], cocs[1], cocs[2], cocs[3])]
        found = merged(samples)
        np.testing.assert_allclose([depth for *_, depth in found], [depth_at(coc) for coc in cocs[:3]], rtol=1e-5)

    def test_a_surface_of_little_alpha_is_dropped_before_one_behind_it(self):
        cocs, alphas = [-9.0, -4.0, 0.0, 5.0], [1.0, 0.1, 1.0, 1.0]
        found = merged([[(alpha, alpha, depth_at(coc))] for coc, alpha in zip(cocs, alphas, strict=True)])
        np.testing.assert_allclose(
            [depth for *_, depth in found], [depth_at(coc) for coc in (-9.0, 0.0, 5.0)], rtol=1e-5
        )

    def test_of_surfaces_that_are_visible_alike_the_farthest_is_dropped(self):
        cocs = [-9.0, -4.0, 0.0, 5.0]
        found = merged([[(0.0, 1e-18, depth_at(coc))] for coc in cocs])
        np.testing.assert_allclose([depth for *_, depth in found], [depth_at(coc) for coc in cocs[:3]], rtol=1e-5)

    def test_background_is_not_dropped(self):
        cocs = [-9.0, -4.0, 0.0]
        found = merged([[(1.0, 1.0, depth_at(coc))] for coc in cocs] + [[(0.5, 1.0, SKY)]])
        self.assertEqual([alpha for _, alpha, _ in found], [0.25, 0.25, 1.0])
        self.assertEqual(found[2][0], 0.5)


class Background(unittest.TestCase):
    def test_it_continues_behind_what_covers_part_of_the_pixel(self):
        near = (1.0, 1.0, depth_at(-9.0))
        for samples in ([[near]] * 3 + [[(0.5, 1.0, SKY)]], [[near, (0.5, 1.0, SKY)]] * 3 + [[(0.5, 1.0, SKY)]]):
            found = merged(samples)
            self.assertEqual([alpha for _, alpha, _ in found], [0.75, 1.0], "whoever records it")
            self.assertEqual(found[1][0], 0.5)
            self.assertGreaterEqual(found[1][2], 1e9)

    def test_it_is_kept_where_every_sample_hides_it(self):
        found = merged([[(1.0, 1.0, depth_at(-9.0)), (0.5, 1.0, SKY)]] * 4)
        self.assertEqual([(color, alpha) for color, alpha, _ in found], [(1.0, 1.0), (0.5, 1.0)])

    def test_it_is_as_opaque_as_it_is_seen(self):
        np.testing.assert_allclose(merged([[(0.1, 0.25, SKY)]] * 4)[0][:2], (0.1, 0.25))
        np.testing.assert_allclose(
            merged([[(0.5, 1.0, SKY)]] * 2 + [[]] * 2)[0][:2], (0.25, 0.5), err_msg="half is empty"
        )

    def test_it_is_not_merged_with_what_is_far(self):
        found = merged([[(1.0, 1.0, depth_at(9.9))]] * 3 + [[(0.5, 1.0, SKY)]])
        self.assertEqual([alpha for _, alpha, _ in found], [0.75, 1.0])

    def test_nothing_is_one_empty_layer(self):
        self.assertEqual(merged([[(0.0, 0.0, SKY)]] * 4)[0][:2], (0.0, 0.0))


class Grids(unittest.TestCase):
    def phases(self):
        random = np.random.default_rng(2)

        def layer():
            color, alpha, depth = (random.random((3, 5, *more)).astype(np.float32) for more in ((3,), (), ()))
            return Layer(color, alpha, depth, {"a": alpha * 2}, {"b": depth * 2})

        return [[layer(), layer()] for _ in range(9)]

    def test_interleaving_puts_phase_i_into_column_i_mod_s_and_row_i_div_s(self):
        phases = self.phases()
        layers = interleave(phases)
        self.assertEqual(layers[1].color.shape, (9, 15, 3))
        self.assertEqual(layers[1].alpha[3 * 2 + 1, 3 * 4 + 2], phases[1 * 3 + 2][1].alpha[2, 4])

    def test_splitting_undoes_interleaving(self):
        for before, after in zip(self.phases(), split(interleave(self.phases()), 3), strict=True):
            for a, b in zip(before, after, strict=True):
                np.testing.assert_array_equal(a.color, b.color)
                np.testing.assert_array_equal(a.sums["a"], b.sums["a"])
                np.testing.assert_array_equal(a.means["b"], b.means["b"])

    def test_pixels_do_not_depend_on_each_other(self):
        phases = self.phases()
        whole = merge(phases, LENS, WIDTH_PX)
        alone = merge([[layer.rows(1, 2) for layer in phase] for phase in phases], LENS, WIDTH_PX)
        for a, b in zip(whole, alone, strict=False):
            np.testing.assert_array_equal(a.depth[1:2], b.depth)
            np.testing.assert_array_equal(a.color[1:2], b.color)

    def test_bands_are_put_below_each_other_and_filled_up_with_empty_layers(self):
        above, below = self.phases()[0], self.phases()[1][:1]
        first, second = stacked([above, below])
        np.testing.assert_array_equal(first.alpha, np.concatenate([above[0].alpha, below[0].alpha]))
        np.testing.assert_array_equal(second.alpha[:3], above[1].alpha)
        np.testing.assert_array_equal(second.alpha[3:], 0.0)

    def test_the_number_of_peels_limits_the_layers(self):
        cocs = [-9.0, -6.0, -3.0, 0.0, 3.0]
        phases = pixel([[(1.0, 1.0, depth_at(coc)) for coc in cocs]])
        self.assertEqual([len(merge(phases, LENS, WIDTH_PX, peels)) for peels in (None, 2, 1)], [5, 4, 3])

    def test_samples_that_form_no_square_are_refused(self):
        with self.assertRaisesRegex(ExportError, "3 samples"):
            merge(self.phases()[:3], LENS, WIDTH_PX)
