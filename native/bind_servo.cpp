// SPDX-License-Identifier: Apache-2.0
// The kernels of the servo in Python.

#include "bind_servo.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "arrays.hpp"
#include "filtering.hpp"
#include "searching.hpp"
#include "sightings.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace grasptrack {

namespace {

using HandArray = Input<double, 3>;
using NoiseArray = Input<double, 4>;

// How many points a state has.
std::size_t count_points(const ValueArray &state) {
    const std::size_t size = state.shape(0);
    if (size <= state::points || (size - state::points) % 2 != 0)
        throw std::invalid_argument("a state is 39 numbers and two for each point");
    return (size - state::points) / 2;
}

void check_size(const RowArray &matrix, std::size_t n) {
    const std::size_t size = unknown::shape + 2 * n;
    if (matrix.shape(0) != size || matrix.shape(1) != size)
        throw std::invalid_argument("a covariance has a row and a column for each unknown");
}

void check_hands(const HandArray &hands, const ValueArray &later) {
    if (hands.shape(0) == 0 || hands.shape(1) != 4 || hands.shape(2) != 4 || later.shape(0) != hands.shape(0))
        throw std::invalid_argument("poses are (N, 4, 4), one or more, each with its time");
}

nb::object copied(const double *values, std::size_t count) {
    Output out(count);
    std::copy(values, values + count, out.values());
    return out.array();
}

nb::object py_retract_state(const ValueArray &from, const ValueArray &step) {
    const std::size_t n = count_points(from);
    if (step.shape(0) != unknown::shape + 2 * n) throw std::invalid_argument("a step has a number for each unknown");
    Output out(from.shape(0));
    stepped(from.data(), step.data(), n, out.values());
    return out.array();
}

nb::tuple py_expected_sightings(const ValueArray &state, const HandArray &hands, const ValueArray &later) {
    const std::size_t n = count_points(state), m = unknown::shape + 2 * n;
    check_hands(hands, later);
    const std::size_t N = hands.shape(0);
    Output pixels(N * n, 2), slopes(2 * N * n, m);
    std::fill(slopes.values(), slopes.values() + 2 * N * n * m, 0.0);
    for (std::size_t k = 0; k < N; ++k)
        for (std::size_t i = 0; i < n; ++i) {
            const double *hand = hands.data() + 16 * k;
            const Seen one(state.data(), hand, later.data()[k], i);
            double J[2][unknown::own];
            one.slopes(state.data(), hand, later.data()[k], i, J);
            for (std::size_t r = 0; r < 2; ++r) {
                const std::size_t row = 2 * (k * n + i) + r;
                pixels.values()[row] = one.at[r];
                for (std::size_t c = 0; c < unknown::own; ++c) slopes.values()[row * m + column(c, i)] = J[r][c];
            }
        }
    return nb::make_tuple(pixels.array(), slopes.array());
}

nb::tuple py_advance_state(const ValueArray &from, const RowArray &covariance, double seconds, double drift,
                           double wander, double twirl) {
    const std::size_t n = count_points(from), m = unknown::shape + 2 * n;
    check_size(covariance, n);
    Output moved(from.shape(0)), wider(m, m);
    std::copy(from.data(), from.data() + from.shape(0), moved.values());
    std::copy(covariance.data(), covariance.data() + m * m, wider.values());
    advance_state(moved.values(), wider.values(), n, seconds, drift, wander, twirl);
    return nb::make_tuple(moved.array(), wider.array());
}

nb::tuple py_filter_sighting(const ValueArray &state, const RowArray &covariance, const RowArray &hand,
                             const PointArray &points, const HandArray &noise, double robust) {
    const std::size_t n = count_points(state), m = unknown::shape + 2 * n;
    check_size(covariance, n);
    if (hand.shape(0) != 4 || hand.shape(1) != 4) throw std::invalid_argument("a pose is (4, 4)");
    if (points.shape(0) != n || noise.shape(0) != n || noise.shape(1) != 2 || noise.shape(2) != 2)
        throw std::invalid_argument("each point needs its noise, (2, 2)");
    Output moved(state.shape(0)), left(m, m), off(2 * n);
    std::copy(state.data(), state.data() + state.shape(0), moved.values());
    std::copy(covariance.data(), covariance.data() + m * m, left.values());
    const double size = filter_sighting(moved.values(), left.values(), hand.data(), points.data(), noise.data(), n,
                                        robust, off.values());
    return nb::make_tuple(moved.array(), left.array(), off.array(), size);
}

nb::tuple py_calibrate_batch(const ValueArray &origin, const RowArray &known, const HandArray &hands,
                              const ValueArray &later, const HandArray &points, const NoiseArray &noise,
                              const ValueArray &start, double damping, std::int64_t steps, double robust,
                              double least_fall, double most_damping) {
    const std::size_t n = count_points(origin), m = unknown::shape + 2 * n, N = hands.shape(0);
    check_size(known, n);
    check_hands(hands, later);
    if (start.shape(0) != origin.shape(0)) throw std::invalid_argument("both states have as many points");
    if (points.shape(0) != N || points.shape(1) != n || points.shape(2) != 2 || noise.shape(0) != N ||
        noise.shape(1) != n || noise.shape(2) != 2 || noise.shape(3) != 2)
        throw std::invalid_argument("each point needs its noise, (2, 2)");
    SightingEvidence evidence({later.data(), hands.data(), points.data(), noise.data(), N, n}, origin.data(),
                              known.data(), robust);
    const Searched found =
        calibrate_batch(evidence, start.data(), n, damping, steps, least_fall, most_damping);
    Output covariance(m, m);
    Factors(evidence.A, m).inverse(covariance.values());
    return nb::make_tuple(copied(found.state.data(), found.state.size()), covariance.array(), found.damping,
                          found.settled, found.scale);
}

}  // namespace

void bind_servo(nb::module_ &m) {
    m.def("advance_state", &py_advance_state, "state"_a, "covariance"_a, "seconds"_a, "drift"_a, "wander"_a, "twirl"_a);
    m.def("expected_sightings", &py_expected_sightings, "state"_a, "hands"_a, "later"_a);
    m.def("filter_sighting", &py_filter_sighting, "state"_a, "covariance"_a, "hand"_a, "points"_a, "noise"_a,
          "robust"_a);
    m.def("calibrate_batch", &py_calibrate_batch, "origin"_a, "known"_a, "hands"_a, "later"_a, "points"_a, "noise"_a,
          "start"_a, "damping"_a, "steps"_a, "robust"_a, "least_fall"_a, "most_damping"_a);
    m.def("retract_state", &py_retract_state, "state"_a, "step"_a);
}

}  // namespace grasptrack
