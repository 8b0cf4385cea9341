//! Costs at sizes that were not measured.

/// Cost by size, from a few measurements.
///
/// Between two sizes the cost goes by a power of the size, below the smallest by the power of the two smallest; above
/// the largest, and from one measurement alone, in proportion. Much of a training does not grow with its photographs,
/// so that a small scene in proportion makes four of a large one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Sizes, ascending, and their costs; both above 0.
    points: Vec<(f64, f64)>,
}

/// Costs below this are taken for it: a power of nothing is nothing.
const LEAST_COST: f64 = 1e-9;

impl Curve {
    /// Of measured sizes and costs. Of several costs at one size the largest counts; sizes that are not above 0 say
    /// nothing.
    pub fn new(measured: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let mut points: Vec<(f64, f64)> = measured
            .into_iter()
            .filter(|(size, cost)| *size > 0.0 && cost.is_finite())
            .map(|(size, cost)| (size, cost.max(LEAST_COST)))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
        points.dedup_by(|later, kept| later.0 == kept.0);
        Self { points }
    }

    /// The cost at a size; 0 where nothing was measured.
    pub fn at(&self, size: f64) -> f64 {
        let (Some(&first), Some(&last)) = (self.points.first(), self.points.last()) else {
            return 0.0;
        };
        let above = self.points.partition_point(|(at, _)| *at < size);
        let (from, power) = match (above, self.points.get(1)) {
            (_, None) => (first, 1.0),
            (0, Some(&second)) => (first, power(first, second).clamp(0.0, 1.0)),
            (above, _) => match self.points.get(above) {
                Some(&next) => (self.points[above - 1], power(self.points[above - 1], next)),
                None => (last, 1.0),
            },
        };
        from.1 * (size / from.0).powf(power)
    }
}

/// The power of the size that leads from one point to the other.
fn power(from: (f64, f64), to: (f64, f64)) -> f64 {
    (to.1 / from.1).ln() / (to.0 / from.0).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measured_sizes_have_their_measured_costs_and_the_rest_lies_between() {
        let curve = Curve::new([(100.0, 40.0), (10.0, 20.0), (10.0, 15.0)]);
        for (size, cost) in [(10.0, 20.0), (100.0, 40.0), (1000.0, 400.0)] {
            assert!((curve.at(size) - cost).abs() < 1e-9, "{size}");
        }
        let middle = curve.at(1000.0_f64.sqrt());
        assert!((middle - 800.0_f64.sqrt()).abs() < 1e-9, "{middle}");
        assert!((curve.at(1.0) - 10.0).abs() < 1e-9);
    }

    #[test]
    fn one_measurement_goes_in_proportion_and_none_costs_nothing() {
        assert!((Curve::new([(10.0, 3.0)]).at(5.0) - 1.5).abs() < 1e-12);
        assert_eq!(Curve::default().at(5.0), 0.0);
        assert_eq!(Curve::new([(0.0, 3.0)]).at(5.0), 0.0);
        // A stage that costs nothing.
        assert!(Curve::new([(1.0, 0.0), (2.0, 0.0)]).at(7.0) < 1e-6);
    }

    #[test]
    fn costs_that_fall_with_the_size_do_not_explode_below() {
        let curve = Curve::new([(10.0, 40.0), (100.0, 20.0)]);
        assert!((curve.at(0.1) - 40.0).abs() < 1e-9);
    }
}
