//! A translucent plane of alpha α lets 1 − α of the light behind it pass, however it is tilted and whichever peels hold it.

use super::engine::{Engine, Setup};
use super::scenes::{EMPTY, Pixel, averaged, grey, inner, layer, mean, of_wall, veil, wall};
use super::{Figure, Measured, Promise, figure};
use thinlens::methods::Law;
use thinlens::scene::Layer;

const SIZE: usize = 40;

/// Pixels nearer to a side than this see what lies past the border, where a tilted plane goes on level.
const MARGIN: usize = 14;

const ALPHAS: [f32; 3] = [0.9, 0.5, 0.1];

/// Change of the CoC radius from pixel to pixel.
const SLOPES_PX: [f32; 4] = [0.5, 0.25, 0.125, 0.06];

pub(crate) const TILTED_PANE: Measured =
    Measured { law: Law::TiltedPane, bound: 1e-3, promised_by: Promise::LensSampling, figures: tilted_panes };

pub(crate) const SHEET_OF_TWO_PEELS: Measured =
    Measured { law: Law::SheetOfTwoPeels, bound: 1e-3, promised_by: Promise::LensSampling, figures: sheets };

/// A plane's CoC radius: `centre_px` in the middle of the frame, changing by `slope_px` a pixel in `direction`.
#[derive(Clone, Copy)]
struct Tilt {
    centre_px: f32,
    slope_px: f32,
    direction: Direction,
}

#[derive(Debug, Clone, Copy)]
enum Direction {
    Down,
    Across,
    Diagonal,
}

impl Tilt {
    fn coc_px(self, x: usize, y: usize) -> f32 {
        let [x, y] = [x, y].map(|at| at as f32 - 0.5 * SIZE as f32);
        let along = match self.direction {
            Direction::Down => y,
            Direction::Across => x,
            Direction::Diagonal => (x + y) * std::f32::consts::FRAC_1_SQRT_2,
        };
        self.centre_px + self.slope_px * along
    }

    fn name(self) -> String {
        format!("{} px {:?} from {}", self.slope_px, self.direction, self.centre_px).to_lowercase()
    }
}

fn tilts() -> Vec<Tilt> {
    let directions = [Direction::Down, Direction::Across, Direction::Diagonal];
    let of_slope = |slope_px| {
        directions.map(|direction| [0.0, -6.0].map(|centre_px| Tilt { centre_px, slope_px, direction }))
    };
    SLOPES_PX.into_iter().flat_map(of_slope).flatten().collect()
}

/// How far the mean of channel `k` of a scene of `layers` is from `expected`.
fn error(engine: &Engine, layers: Vec<Layer>, k: usize, expected: f32) -> f64 {
    let image = engine.blur(averaged(layers), Setup::views(64));
    (mean(&image, k, &inner(SIZE, SIZE, MARGIN)) - f64::from(expected)).abs()
}

fn tilted_panes(engine: &Engine) -> Vec<Figure> {
    let cases =
        ALPHAS.into_iter().flat_map(|alpha| tilts().into_iter().map(move |tilt| (alpha, tilt))).collect();
    let pane = |alpha: f32, tilt: Tilt| layer(SIZE, SIZE, |x, y| (veil(alpha), tilt.coc_px(x, y)));
    let behind =
        |tilt: Tilt| Tilt { centre_px: tilt.centre_px + 20.0, slope_px: -0.5 * tilt.slope_px, ..tilt };
    let measured = engine.some_of(cases, 7).into_iter().flat_map(|(alpha, tilt)| {
        let passes = 1.0 - alpha;
        let two = vec![pane(alpha, tilt), pane(alpha, behind(tilt)), wall(SIZE, SIZE)];
        [
            ("before white", error(engine, vec![pane(alpha, tilt), wall(SIZE, SIZE)], 0, passes)),
            ("before nothing", error(engine, vec![pane(alpha, tilt)], 3, alpha)),
            ("two before white", error(engine, two, 0, passes * passes)),
        ]
        .map(|(where_, value)| figure(format!("alpha {alpha} {where_}, {}", tilt.name()), value))
    });
    measured.collect()
}

/// A pane behind focus and a wall; before them, near focus, an opaque bar, behind which the pane is the second peel.
fn sheets(engine: &Engine) -> Vec<Figure> {
    const BAR: std::ops::Range<usize> = 18..22;
    /// The bar's CoC radius, and how far from the bar a pixel sees nothing of it.
    const BAR_PX: f32 = 1.0;
    const CLEAR_OF_BAR: usize = 3;
    let bar: (Pixel, f32) = (grey(0.5), BAR_PX);
    let sees_no_bar = |&(x, _): &(usize, usize)| x + CLEAR_OF_BAR < BAR.start || x >= BAR.end + CLEAR_OF_BAR;
    let seen: Vec<_> = inner(SIZE, SIZE, 12).into_iter().filter(sees_no_bar).collect();
    let cases =
        ALPHAS.into_iter().flat_map(|alpha| [0.0, 0.125, 0.25].map(|slope_px| (alpha, slope_px))).collect();
    let measured = engine.some_of(cases, 4).into_iter().map(|(alpha, slope_px)| {
        let tilt = Tilt { centre_px: 8.0, slope_px, direction: Direction::Down };
        let pane = |x, y| (veil(alpha), tilt.coc_px(x, y));
        let peels = |at: usize| {
            layer(SIZE, SIZE, move |x, y| match (at, BAR.contains(&x)) {
                (0, true) => bar,
                (0, false) | (1, true) => pane(x, y),
                _ => of_wall(),
            })
        };
        let last = layer(SIZE, SIZE, |x, _| if BAR.contains(&x) { of_wall() } else { EMPTY });
        let image = engine.blur(averaged(vec![peels(0), peels(1), last]), Setup::views(128));
        let off = (mean(&image, 0, &seen) - f64::from(1.0 - alpha)).abs();
        figure(format!("alpha {alpha}, {slope_px} px a row"), off)
    });
    measured.collect()
}
