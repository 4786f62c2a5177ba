// SPDX-License-Identifier: Apache-2.0
// Contours as curves, their moments and places, and homographies, in Python.

#include "../arrays.hpp"
#include "crossing.hpp"
#include "curve.hpp"
#include "homography.hpp"
#include "moments.hpp"
#include "places.hpp"

namespace grasptrack {

namespace {

nb::object project_to_contour_(const PointArray &points, const IndexArray &offsets, const PointArray &queries, double grain) {
    Output<> out(queries.shape(0), 3);
    static_assert(sizeof(Projected) == 3 * sizeof(double));
    project_to_contour(outline_of(points, offsets), points_of(queries), reinterpret_cast<Projected *>(out.values()));
    double *v = out.values();
    for (std::size_t i = 0; grain > 0 && i < 3 * queries.shape(0); ++i) v[i] = std::nearbyint(v[i] * grain) / grain;
    return out.array();
}

nb::object point_at(const PointArray &points, const IndexArray &offsets, const RowArray &places) {
    const Outline outline = outline_of(points, offsets);
    const std::size_t count = count_places(places);
    Output<> out(count, 2);
    for (std::size_t k = 0; k < count; ++k) out.vectors()[k] = place_of(outline, places, k).point();
    return out.array();
}

}  // namespace

void bind_geometry(nb::module_ &m) {
    m.def("arc_length", [](const PointArray &points) {
        const Points contour = contour_of(points);
        Output<> out(contour.size + 1);
        arc_length(contour, out.values());
        return out.array();
    }, "points"_a);
    m.def("resample", [](const PointArray &points, std::int64_t count, double smooth) {
        check_within(static_cast<double>(count), 1, 1 << 24, "count");
        const Points contour = contour_of(points);
        Output<> out(count, 2);
        resample(contour, static_cast<std::size_t>(count), smooth, out.vectors());
        return out.array();
    }, "points"_a, "count"_a, "smooth"_a);
    m.def("first_crossing", [](const PointArray &points) {
        const auto [i, j] = first_crossing(contour_of(points));
        return nb::make_tuple(i, j);
    }, "points"_a);
    m.def("blend_normals", [](const PointArray &points) {
        const Points contour = contour_of(points);
        Output<> out(contour.size, 2);
        blend_normals(contour, out.vectors());
        return out.array();
    }, "points"_a);
    m.def("curvature_vector", [](const PointArray &points, const std::optional<FlagArray> &clipped, double smoothing,
                                 double whole) {
        static const Record record("CurvatureVector");
        const Points contour = contour_of(points);
        if (clipped && clipped->shape(0) != contour.size) throw std::invalid_argument("each point needs its flag");
        Output<> arc(contour.size + 1), out(contour.size);
        curvature_vector(contour, clipped ? clipped->data() : nullptr, smoothing, whole, arc.values(), out.values());
        return record(arc.array(), out.array());
    }, "points"_a, "clipped"_a.none(), "smoothing"_a, "whole"_a = 0.0);
    m.def("polygon_moments", [](const PointArray &points, const IndexArray &offsets) {
        static const Record record("PolygonMoments");
        const Moments a = polygon_moments(outline_of(points, offsets));
        return record(a.area, a.x, a.y, a.angle, a.major, a.minor, a.t30, a.t21, a.t12, a.t03);
    }, "points"_a, "offsets"_a);
    m.def("project_to_contour", [](const PointArray &points, const IndexArray &offsets, const PointArray &queries) {
        return project_to_contour_(points, offsets, queries, 0);
    }, "points"_a, "offsets"_a, "queries"_a);
    m.def("fixed_places", [](const PointArray &points, const IndexArray &offsets, const PointArray &queries) {
        return project_to_contour_(points, offsets, queries, 4294967296.0);
    }, "points"_a, "offsets"_a, "queries"_a);
    m.def("point_at", &point_at, "points"_a, "offsets"_a, "places"_a);
    m.def("carry_places", [](const RowArray &places, const IndexArray &offsets, const PointArray &points,
                             const IndexArray &current) {
        if (offsets.shape(0) != current.shape(0) ||
            !std::equal(offsets.data(), offsets.data() + offsets.shape(0), current.data()))
            throw std::invalid_argument("the outlines' points do not correspond");
        return point_at(points, current, places);
    }, "places"_a, "offsets"_a, "points"_a, "current"_a);
    m.def("carry_points", [](const MatrixArray &H, const PointArray &points) {
        static const Record record("CarriedPoints");
        Output<> out(points.shape(0), 2);
        const double in_front = carry_points(H.data(), points_of(points), out.vectors());
        return record(out.array(), in_front);
    }, "H"_a, "points"_a);
    m.def("carry_normals", [](const MatrixArray &H, const PointArray &points, const PointArray &normals) {
        if (normals.shape(0) != points.shape(0)) throw std::invalid_argument("each point needs its normal");
        static_assert(sizeof(CarriedNormal) == 5 * sizeof(double));
        Output<> out(points.shape(0), 5);
        carry_normals(H.data(), points_of(points), vectors(normals), reinterpret_cast<CarriedNormal *>(out.values()));
        return out.array();
    }, "H"_a, "points"_a, "normals"_a);
    m.def("distortion", [](const MatrixArray &H, const PointArray &points) {
        static const Record record("Distortion");
        const Distortion worst = distortion(H.data(), points_of(points));
        return record(worst.in_front, worst.determinant, worst.ratio);
    }, "H"_a, "points"_a);
}

}  // namespace grasptrack
