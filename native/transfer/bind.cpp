// SPDX-License-Identifier: Apache-2.0
// The steps of two transfers, by a homography and by a grasp line, in Python.

#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "../arrays.hpp"
#include "grasp_line.hpp"
#include "homography.hpp"

namespace grasptrack {

namespace {

using Indices = std::vector<std::int64_t>;

// Of grasptrack.kernels.results.CurvatureVector and MatchWindow.
using Profile_ = std::tuple<ValueArray, ValueArray>;
using MatchWindow = std::tuple<double, double, std::int64_t, double, double>;

Cyclic cyclic_of(const Profile_ &profile) {
    const auto &[arc, values] = profile;
    check_arc(values.shape(0), arc);
    return {values.data(), arc.data(), static_cast<std::int64_t>(values.shape(0))};
}

nb::object match_curvature_(const Profile_ &first, const Indices &indices, const Profile_ &second,
                            const std::vector<double> &centres, const MatchWindow &window) {
    static const Record record("CurvatureMatches");
    const auto [kappa, reach, radius, step, tolerance] = window;
    const Cyclic one = cyclic_of(first), other = cyclic_of(second);
    check_indices(indices.data(), indices.size(), static_cast<std::size_t>(one.size));
    check_within(static_cast<double>(radius), 0, 1000, "radius");
    if (centres.size() != indices.size()) throw std::invalid_argument("each index needs its centre");
    nb::list samples, errors, places;
    for (const Match &match : match_curvature(one, indices, other, centres, kappa, reach, static_cast<int>(radius), step, tolerance)) {
        samples.append(match.sample);
        errors.append(match.error);
        places.append(match.place);
    }
    return record(samples, errors, places);
}

}  // namespace

void bind_transfer(nb::module_ &m) {
    m.def("select_points", [](const PointArray &points, const ValueArray &arc, const ValueArray &values, double separation,
                              double prominence) {
        static const Record record("SelectedPoints");
        check_arc(points.shape(0), arc);
        check_arc(values.shape(0), arc);
        const Selected selected = select_points(points_of(points), arc.data(), values.data(), separation, prominence);
        return record(selected.peaks, selected.triangle);
    }, "points"_a, "arc"_a, "curvature"_a, "separation"_a, "prominence"_a);
    m.def("best_quadrilateral", [](const PointArray &points, const ValueArray &weights) {
        static const Record record("Quadrilateral");
        if (weights.shape(0) != points.shape(0)) throw std::invalid_argument("each point needs its weight");
        check_size(points.shape(0), 32, "points");
        const auto q = best_quadrilateral([&](int i) { return points_of(points)[i]; },
                                          [&](int i) { return weights.data()[i]; }, static_cast<int>(points.shape(0)));
        return record(std::vector<int>(q.index.begin(), q.index.end()), q.triangle);
    }, "points"_a, "weights"_a);
    m.def("match_curvature", &match_curvature_, "first"_a, "indices"_a, "second"_a, "centres"_a, "window"_a);
    m.def("fit_homography", [](const PointArray &points1, const Indices &indices1, const PointArray &points2,
                               const std::vector<double> &places2) {
        static const Record record("FittedHomography");
        if (indices1.size() != 4 || places2.size() != 4)
            throw std::invalid_argument("four points of each contour are needed");
        check_indices(indices1.data(), 4, points1.shape(0));
        for (const double place : places2)
            if (!(place >= 0.0 && place < static_cast<double>(points2.shape(0))))
                throw std::invalid_argument("a place on the second contour is out of range");
        Vec source[4], target[4];
        for (int i = 0; i < 4; ++i)
            source[i] = vectors(points1)[indices1[i]], target[i] = cubic_point(points_of(points2), places2[i]);
        Output<> H(3, 3);
        homography_4(source, target, H.values());
        const Distortion worst = distortion(H.values(), {source, 4});
        return record(H.array(), worst.in_front, worst.determinant, worst.ratio);
    }, "points1"_a, "indices1"_a, "points2"_a, "places2"_a);
    m.def("refine_contacts", [](const MatrixArray &H, const PointArray &contacts, const std::optional<PointArray> &normals,
                                const PointArray &points, const IndexArray &offsets) {
        static const Record record("RefinedContacts");
        const std::size_t count = contacts.shape(0);
        if (count == 0) throw std::invalid_argument("contacts are needed");
        if (normals ? normals->shape(0) != count : count != 2)
            throw std::invalid_argument(normals ? "each contact needs its normal" : "contacts without normals are two");
        Output<> out(count, 2);
        const Refined refined = refine_contacts(H.data(), points_of(contacts), normals ? vectors(*normals) : nullptr,
                                                outline_of(points, offsets), out.vectors());
        return record(out.array(), refined.residual, refined.growth, refined.in_front);
    }, "H"_a, "contacts"_a, "normals"_a.none(), "points"_a, "offsets"_a);
    m.def("grasp_line", [](const PointArray &points, const IndexArray &offsets, const PointArray &contacts) {
        static const Record record("DescribedLine");
        if (contacts.shape(0) != 2) throw std::invalid_argument("a grasp line has two contacts");
        const Moments a = polygon_moments(outline_of(points, offsets));
        const DescribedLine d = grasp_line(a, vectors(contacts)[0], vectors(contacts)[1]);
        return record(d.line.d_c, d.line.alpha_m, d.line.d_1, d.line.d_2, a.area, nb::make_tuple(a.x, a.y),
                      a.angle, a.major, a.minor, d.sine, d.opening);
    }, "points"_a, "offsets"_a, "contacts"_a);
    m.def("carry_grasp_line", [](const PointArray &points, const IndexArray &offsets, const std::array<double, 4> &line,
                                 const std::array<double, 4> &r, const std::array<double, 2> &ahead) {
        static const Record record("CarriedLine");
        const Outline outline = outline_of(points, offsets);
        const Moments a = polygon_moments(outline);
        Output<> contacts(2, 2), H(3, 3);
        const double residual =
            carry_grasp_line(outline, a, {line[0], line[1], line[2], line[3]}, {r[0], r[1], r[2], r[3]},
                             {ahead[0], ahead[1]}, contacts.vectors(), H.values());
        return record(contacts.array(), H.array(), residual, a.area, a.major, a.minor);
    }, "points"_a, "offsets"_a, "line"_a, "reference"_a, "ahead"_a);
}

}  // namespace grasptrack
