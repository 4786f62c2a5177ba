// SPDX-License-Identifier: Apache-2.0
// The kernels that match two outlines without a prior, in Python.

#include "bind_match.hpp"

#include <algorithm>
#include <limits>
#include <vector>

#include "arrays.hpp"
#include "laying.hpp"
#include "nearest.hpp"
#include "starts.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace grasptrack {

namespace {

nb::object py_initial_alignments(const PointArray &first, const PointArray &second, const PointArray &bends,
                             std::int64_t count, double apart, std::int64_t most) {
    if (count < 4 || (count & (count - 1)) != 0)
        throw std::invalid_argument("count must be a power of 2, at least 4, not " + std::to_string(count));
    const auto found = initial_alignments(contour_of(first), contour_of(second), vectors(bends), bends.shape(0),
                                      static_cast<std::size_t>(count), apart,
                                      static_cast<std::size_t>(std::max<std::int64_t>(most, 0)));
    Output out(found.size(), 11);
    for (std::size_t i = 0; i < found.size(); ++i) {
        double *row = out.values() + 11 * i;
        row[0] = found[i].left, row[1] = found[i].shift;
        std::copy(found[i].H.begin(), found[i].H.end(), row + 2);
    }
    return out.array();
}

void check_samples(const PointArray &points, const PointArray &normals, const PointArray &targets,
                   const PointArray &target_normals) {
    if (points.shape(0) == 0 || normals.shape(0) != points.shape(0) || target_normals.shape(0) != targets.shape(0))
        throw std::invalid_argument("points are needed, each with its normal");
}

void check_reach(double reach) {
    if (!(reach > 0)) throw std::invalid_argument("reach must be above 0, not " + number(reach));
}

nb::object py_outline_gaps(const PointArray &points, const PointArray &normals, const PointArray &targets,
                           const PointArray &target_normals, const IndexArray &offsets, double reach) {
    check_samples(points, normals, targets, target_normals);
    check_reach(reach);
    const NearestAlike nearest(outline_of(targets, offsets), vectors(target_normals));
    const std::size_t m = points.shape(0);
    Output out(m);
    for (std::size_t i = 0; i < m; ++i) {
        const Vec at = vectors(points)[i];
        const std::ptrdiff_t j = nearest.find(at, vectors(normals)[i], reach);
        out.values()[i] = j < 0 ? reach : std::min(nearest.gap(at, static_cast<std::size_t>(j)), reach);
    }
    return out.array();
}

nb::object py_align_projective(const RowArray &starts, const PointArray &points, const PointArray &normals,
                           const PointArray &targets, const PointArray &target_normals, const IndexArray &offsets,
                           const ValueArray &reaches, const ValueArray &damping, const IndexArray &strides,
                           double least_noise) {
    check_samples(points, normals, targets, target_normals);
    const std::size_t count = reaches.shape(0);
    if (count == 0 || damping.shape(0) != count || strides.shape(0) != count)
        throw std::invalid_argument("each step needs its reach, damping and stride");
    std::vector<LayStep> steps;
    for (std::size_t i = 0; i < count; ++i) {
        check_reach(reaches.data()[i]);
        if (strides.data()[i] < 1)
            throw std::invalid_argument("a stride is 1 or more, not " + std::to_string(strides.data()[i]));
        steps.push_back({reaches.data()[i], damping.data()[i], static_cast<std::size_t>(strides.data()[i])});
    }
    if (starts.shape(1) != 9) throw std::invalid_argument("a homography has nine elements");
    const NearestAlike nearest(outline_of(targets, offsets), vectors(target_normals));
    Laying laying({vectors(points), vectors(normals), points.shape(0)}, nearest, least_noise);
    Output out(starts.shape(0), 10);
    for (std::size_t k = 0; k < starts.shape(0); ++k) {
        double *row = out.values() + 10 * k;
        for (int i = 0; i < 9; ++i) row[i] = starts.data()[9 * k + i] / starts.data()[9 * k + 8];
        bool good = true;
        for (std::size_t s = 0; good && s < count; ++s) good = laying.step(row, steps[s]);
        row[9] = good ? laying.left(row, steps.back()) : std::numeric_limits<double>::quiet_NaN();
        if (!(row[9] >= 0)) std::fill(row, row + 10, std::numeric_limits<double>::quiet_NaN());
    }
    return out.array();
}

}  // namespace

void bind_match(nb::module_ &m) {
    m.def("align_projective", &py_align_projective, "starts"_a, "points"_a, "normals"_a, "targets"_a, "target_normals"_a,
          "offsets"_a, "reaches"_a, "damping"_a, "strides"_a, "least_noise"_a);
    m.def("outline_gaps", &py_outline_gaps, "points"_a, "normals"_a, "targets"_a, "target_normals"_a, "offsets"_a,
          "reach"_a);
    m.def("initial_alignments", &py_initial_alignments, "first"_a, "second"_a, "bends"_a, "count"_a, "apart"_a, "most"_a);
}

}  // namespace grasptrack
