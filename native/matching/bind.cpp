// SPDX-License-Identifier: Apache-2.0
// What lays one outline on another, in Python.

#include <nanobind/stl/tuple.h>

#include <limits>

#include "../arrays.hpp"
#include "alignment.hpp"
#include "projective.hpp"

namespace grasptrack {

namespace {

void check_samples(const PointArray &points, const PointArray &normals, const PointArray &targets,
                   const PointArray &target_normals) {
    if (points.shape(0) == 0 || normals.shape(0) != points.shape(0) || target_normals.shape(0) != targets.shape(0))
        throw std::invalid_argument("points are needed, each with its normal");
}

void check_reach(double reach) {
    if (!(reach > 0)) throw std::invalid_argument("reach must be above 0, not " + number(reach));
}

// Of grasptrack.kernels.results.AlignmentSteps.
using AlignmentSteps = std::tuple<ValueArray, ValueArray, IndexArray, double>;

nb::object align_projective_(const RowArray &starts, const PointArray &points, const PointArray &normals,
                             const PointArray &targets, const PointArray &target_normals, const IndexArray &offsets,
                             const AlignmentSteps &how) {
    check_samples(points, normals, targets, target_normals);
    const auto &[reaches, damping, strides, least_noise] = how;
    const std::size_t count = reaches.shape(0);
    if (count == 0 || damping.shape(0) != count || strides.shape(0) != count)
        throw std::invalid_argument("each step needs its reach, damping and stride");
    std::vector<AlignmentStep> steps;
    for (std::size_t i = 0; i < count; ++i) {
        check_reach(reaches.data()[i]);
        if (strides.data()[i] < 1)
            throw std::invalid_argument("a stride is 1 or more, not " + std::to_string(strides.data()[i]));
        steps.push_back({reaches.data()[i], damping.data()[i], static_cast<std::size_t>(strides.data()[i])});
    }
    if (starts.shape(1) != 9) throw std::invalid_argument("a homography has nine elements");
    const NearestAlike nearest(outline_of(targets, offsets), vectors(target_normals));
    ProjectiveAlignment alignment(points_of(points), vectors(normals), nearest, least_noise);
    Output<> out(starts.shape(0), 10);
    {
        nb::gil_scoped_release free;
        for (std::size_t k = 0; k < starts.shape(0); ++k) {
            double *row = out.values() + 10 * k;
            for (int i = 0; i < 9; ++i) row[i] = starts.data()[9 * k + i] / starts.data()[9 * k + 8];
            bool good = true;
            for (std::size_t s = 0; good && s < count; ++s) good = alignment.step(row, steps[s]);
            row[9] = good ? alignment.left(row, steps.back()) : std::numeric_limits<double>::quiet_NaN();
            if (!(row[9] >= 0)) std::fill(row, row + 10, std::numeric_limits<double>::quiet_NaN());
        }
    }
    return out.array();
}

}  // namespace

void bind_matching(nb::module_ &m) {
    m.def("align_outlines", [](const PointArray &points1, const ValueArray &arc1, const PointArray &points2,
                               const ValueArray &arc2, std::int64_t count, double tie) {
        static const Record record("CyclicShift");
        check_power_of_2(count);
        check_arc(points1.shape(0), arc1);
        check_arc(points2.shape(0), arc2);
        nb::list out;
        for (const Fit &fit : align_outlines(points_of(points1), arc1.data(), points_of(points2), arc2.data(),
                                             static_cast<std::size_t>(count), tie))
            out.append(record(fit.shift, fit.angle, fit.residual));
        return out;
    }, "points1"_a, "arc1"_a, "points2"_a, "arc2"_a, "count"_a, "tie"_a);
    m.def("initial_alignments", [](const PointArray &first, const PointArray &second, const PointArray &bends,
                                   std::int64_t count, double apart, std::int64_t most) {
        check_power_of_2(count);
        check_size(bends.shape(0), 1000, "bends");
        check_within(static_cast<double>(most), 0, 1000, "most");
        const auto found = initial_alignments(contour_of(first), contour_of(second), vectors(bends), bends.shape(0),
                                              static_cast<std::size_t>(count), apart,
                                              static_cast<std::size_t>(most));
        Output<> out(found.size(), 11);
        for (std::size_t i = 0; i < found.size(); ++i) {
            double *row = out.values() + 11 * i;
            row[0] = found[i].left, row[1] = found[i].shift;
            std::copy(found[i].H.begin(), found[i].H.end(), row + 2);
        }
        return out.array();
    }, "first"_a, "second"_a, "bends"_a, "count"_a, "apart"_a, "most"_a);
    m.def("align_projective", &align_projective_, "starts"_a, "points"_a, "normals"_a, "targets"_a, "target_normals"_a,
          "offsets"_a, "steps"_a);
    m.def("outline_gaps", [](const PointArray &points, const PointArray &normals, const PointArray &targets,
                             const PointArray &target_normals, const IndexArray &offsets, double reach) {
        check_samples(points, normals, targets, target_normals);
        check_reach(reach);
        const NearestAlike nearest(outline_of(targets, offsets), vectors(target_normals));
        const std::size_t m = points.shape(0);
        Output<> out(m);
        for (std::size_t i = 0; i < m; ++i) {
            const Vec at = vectors(points)[i];
            const std::ptrdiff_t j = nearest.find(at, vectors(normals)[i], reach);
            out.values()[i] = j < 0 ? reach : std::min(nearest.gap(at, static_cast<std::size_t>(j)), reach);
        }
        return out.array();
    }, "points"_a, "normals"_a, "targets"_a, "target_normals"_a, "offsets"_a, "reach"_a);
}

}  // namespace grasptrack
