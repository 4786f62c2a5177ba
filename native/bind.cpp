// SPDX-License-Identifier: Apache-2.0
// Where kernels meet Python: arrays in, checks, arrays and tuples out. Those of synthesis are in
// bind_grasp.cpp, of images in bind_images.cpp, of matching in bind_match.cpp, of the pose in bind_pose.cpp, of the servo
// in bind_servo.cpp.

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "alignment.hpp"
#include "arrays.hpp"
#include "bind_grasp.hpp"
#include "bind_images.hpp"
#include "bind_match.hpp"
#include "bind_pose.hpp"
#include "bind_servo.hpp"
#include "contact.hpp"
#include "curvature.hpp"
#include "grasp_line.hpp"
#include "homography.hpp"
#include "inertia.hpp"
#include "lines.hpp"
#include "matching.hpp"
#include "peaks.hpp"
#include "refine.hpp"
#include "wrench.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace grasptrack;

namespace {

nb::object py_arc_length(const PointArray &points) {
    const Points contour = contour_of(points);
    Output out(contour.size + 1);
    arc_length(contour, out.values());
    return out.array();
}

nb::tuple py_curvature_vector(const PointArray &points, const std::optional<FlagArray> &clipped, double smoothing) {
    const Points contour = contour_of(points);
    if (clipped && clipped->shape(0) != contour.size) throw std::invalid_argument("each point needs its flag");
    Output arc(contour.size + 1), out(contour.size);
    curvature_vector(contour, clipped ? clipped->data() : nullptr, smoothing, arc.values(), out.values());
    return nb::make_tuple(arc.array(), out.array());
}

nb::object py_curvature(const PointArray &points, double step) {
    const Points contour = contour_of(points);
    Output out(contour.size);
    curvature(contour, step, out.values());
    return out.array();
}

nb::object py_resample(const PointArray &points, std::int64_t count, double smooth) {
    if (count < 1) throw std::invalid_argument("count must be at least 1, not " + std::to_string(count));
    Output out(static_cast<std::size_t>(count), 2);
    resample(contour_of(points), static_cast<std::size_t>(count), smooth, out.vectors());
    return out.array();
}

nb::object py_blend_normals(const PointArray &points) {
    const Points contour = contour_of(points);
    Output out(contour.size, 2);
    blend_normals(contour, out.vectors());
    return out.array();
}

nb::tuple py_inertia(const PointArray &points, const IndexArray &offsets) {
    const Inertia m = inertia(outline_of(points, offsets));
    return nb::make_tuple(m.area, m.cx, m.cy, m.theta, m.major, m.minor, m.t30, m.t21, m.t12, m.t03);
}

nb::object py_crossings(const PointArray &points, const IndexArray &offsets, double x, double y, double ux, double uy) {
    struct Row {
        double contour, position, t;
    };
    std::vector<Row> rows;
    for_each_crossing(outline_of(points, offsets), {{x, y}, {ux, uy}}, [&](std::size_t c, double position, double t) {
        rows.push_back({static_cast<double>(c), position, t});
    });
    std::stable_sort(rows.begin(), rows.end(), [](const Row &a, const Row &b) { return a.t < b.t; });
    Output out(rows.size(), 3);
    double *v = out.values();
    for (const Row &row : rows) *v++ = row.contour, *v++ = row.position, *v++ = row.t;
    return out.array();
}

nb::tuple py_nearest_crossings(const PointArray &points, const IndexArray &offsets, double x, double y, double ux,
                               double uy, double t1, double t2) {
    Nearest a{t1}, b{t2};
    for_each_crossing(outline_of(points, offsets), {{x, y}, {ux, uy}}, [&](std::size_t, double, double t) {
        a.offer(t);
        b.offer(t);
    });
    return nb::make_tuple(x + a.t * ux, y + a.t * uy, x + b.t * ux, y + b.t * uy);
}

nb::object py_locate(const PointArray &points, const IndexArray &offsets, const PointArray &queries) {
    const Outline outline = outline_of(points, offsets);
    static_assert(sizeof(Located) == 3 * sizeof(double));
    Output out(queries.shape(0), 3);
    locate(outline, points_of(queries), reinterpret_cast<Located *>(out.values()));
    return out.array();
}

nb::object py_fixed_places(const PointArray &points, const IndexArray &offsets, const PointArray &queries) {
    constexpr double grain = 4294967296.0;
    Output out(queries.shape(0), 3);
    locate(outline_of(points, offsets), points_of(queries), reinterpret_cast<Located *>(out.values()));
    double *v = out.values();
    for (std::size_t i = 0; i < 3 * queries.shape(0); ++i) v[i] = std::nearbyint(v[i] * grain) / grain;
    return out.array();
}

nb::object py_point_at(const PointArray &points, const IndexArray &offsets, const RowArray &places) {
    const Outline outline = outline_of(points, offsets);
    const std::size_t count = count_places(places);
    Output out(count, 2);
    for (std::size_t k = 0; k < count; ++k) out.vectors()[k] = place_of(outline, places, k).point();
    return out.array();
}

nb::object py_carry_places(const RowArray &places, const IndexArray &offsets, const PointArray &points,
                           const IndexArray &current) {
    if (offsets.shape(0) != current.shape(0) ||
        !std::equal(offsets.data(), offsets.data() + offsets.shape(0), current.data()))
        throw std::invalid_argument("the outlines' points do not correspond");
    return py_point_at(points, current, places);
}

nb::object py_contact_frames(const PointArray &points, const IndexArray &offsets, const RowArray &places,
                             double width) {
    if (!(width > 0 && std::isfinite(width)))
        throw std::invalid_argument("width must be above 0, not " + number(width));
    const Outline outline = outline_of(points, offsets);
    const std::size_t count = count_places(places);
    Output out(count, 4);
    double *v = out.values();
    for (std::size_t k = 0; k < count; ++k) {
        const ContactFrame frame = contact_frame(place_of(outline, places, k), width);
        *v++ = frame.nx, *v++ = frame.ny, *v++ = frame.flatness, *v++ = frame.used;
    }
    return out.array();
}

nb::object py_homography_4(const PointArray &source, const PointArray &target) {
    if (source.shape(0) != 4 || target.shape(0) != 4) throw std::invalid_argument("four points are needed in each view");
    Output out(3, 3);
    homography_4(vectors(source), vectors(target), out.values());
    return out.array();
}

nb::tuple py_carry_points(const RowArray &H, const PointArray &points) {
    if (H.shape(0) != 3 || H.shape(1) != 3) throw std::invalid_argument("a homography is (3, 3)");
    Output out(points.shape(0), 2);
    const double in_front = carry_points(H.data(), points_of(points), out.vectors());
    return nb::make_tuple(out.array(), in_front);
}

nb::tuple py_distortion(const RowArray &H, const PointArray &points) {
    if (H.shape(0) != 3 || H.shape(1) != 3) throw std::invalid_argument("a homography is (3, 3)");
    const Distortion worst = distortion(H.data(), points_of(points));
    return nb::make_tuple(worst.in_front, worst.determinant, worst.ratio);
}

void check_indices(const std::vector<std::int64_t> &indices, std::size_t points) {
    for (std::int64_t i : indices)
        if (i < 0 || i >= static_cast<std::int64_t>(points)) throw std::invalid_argument("index out of range");
}

nb::tuple py_fit_homography(const PointArray &points1, const std::vector<std::int64_t> &indices1,
                            const PointArray &points2, const std::vector<std::int64_t> &indices2) {
    if (indices1.size() != 4 || indices2.size() != 4)
        throw std::invalid_argument("four points of each contour are needed");
    check_indices(indices1, points1.shape(0));
    check_indices(indices2, points2.shape(0));
    Vec source[4], target[4];
    for (int i = 0; i < 4; ++i) source[i] = vectors(points1)[indices1[i]], target[i] = vectors(points2)[indices2[i]];
    Output H(3, 3);
    homography_4(source, target, H.values());
    const Distortion worst = distortion(H.values(), {source, 4});
    return nb::make_tuple(H.array(), worst.in_front, worst.determinant, worst.ratio);
}

nb::tuple py_refine_contacts(const RowArray &H, const PointArray &contacts, const std::optional<PointArray> &normals,
                             const PointArray &points, const IndexArray &offsets) {
    const std::size_t count = contacts.shape(0);
    if (H.shape(0) != 3 || H.shape(1) != 3) throw std::invalid_argument("a homography is (3, 3)");
    if (normals ? normals->shape(0) != count : count != 2)
        throw std::invalid_argument(normals ? "each contact needs its normal" : "contacts without normals are two");
    Output out(count, 2);
    const Refined refined = refine_contacts(H.data(), points_of(contacts), normals ? vectors(*normals) : nullptr,
                                            outline_of(points, offsets), out.vectors());
    return nb::make_tuple(out.array(), refined.residual, refined.growth, refined.in_front);
}

nb::tuple py_grasp_line(const PointArray &points, const IndexArray &offsets, const PointArray &contacts) {
    if (contacts.shape(0) != 2) throw std::invalid_argument("a grasp line has two contacts");
    const Inertia m = inertia(outline_of(points, offsets));
    const DescribedLine d = grasp_line(m, vectors(contacts)[0], vectors(contacts)[1]);
    return nb::make_tuple(d.line.d_c, d.line.alpha_m, d.line.d_1, d.line.d_2, m.t30, m.t21, m.t12, m.t03, m.area, m.cx,
                          m.cy, m.theta, m.major, m.minor, d.sine, d.opening);
}

nb::tuple py_carry_grasp_line(const PointArray &points, const IndexArray &offsets, const std::array<double, 4> &line,
                              const std::array<double, 8> &reference, const std::array<double, 2> &ahead,
                              double least_skewness) {
    const Outline outline = outline_of(points, offsets);
    const Inertia m = inertia(outline);
    const auto &r = reference;
    Output contacts(2, 2), H(3, 3);
    const CarriedLine carried =
        carry_grasp_line(outline, m, {line[0], line[1], line[2], line[3]},
                         {r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7]}, {ahead[0], ahead[1]}, least_skewness,
                         contacts.vectors(), H.values());
    return nb::make_tuple(contacts.array(), H.array(), carried.residual, m.area, m.major, m.minor, carried.told);
}

nb::tuple py_force_closure(const PointArray &contacts, const PointArray &normals, double cx, double cy, double rho,
                           double friction) {
    const std::size_t count = contacts.shape(0);
    if (count < 2 || count > max_contacts || normals.shape(0) != count)
        throw std::invalid_argument("force closure takes 2 to 8 contacts, each with its normal, not " +
                                    std::to_string(count));
    if (!(rho > 0 && friction >= 0))
        throw std::invalid_argument("rho must be above 0 and friction at least 0, not " + number(rho) + " and " +
                                    number(friction));
    const Closure closure = force_closure(vectors(contacts), vectors(normals), count, {cx, cy}, rho, friction);
    return nb::make_tuple(closure.epsilon, closure.friction_angle);
}

void check_arc(std::size_t points, const ValueArray &arc) {
    if (points < 1 || arc.shape(0) != points + 1)
        throw std::invalid_argument("arc needs one entry more than the contour has points");
}

nb::object py_curvature_peaks(const ValueArray &values, const ValueArray &arc, double separation, double prominence) {
    check_arc(values.shape(0), arc);
    const auto peaks = curvature_peaks(values.data(), arc.data(), static_cast<std::int64_t>(values.shape(0)),
                                       separation, prominence);
    OutputOf<std::int64_t> out(peaks.size());
    std::copy(peaks.begin(), peaks.end(), out.values());
    return out.array();
}

nb::tuple py_best_quadrilateral(const PointArray &points, const ValueArray &weights) {
    if (weights.shape(0) != points.shape(0)) throw std::invalid_argument("each point needs its weight");
    const auto q = best_quadrilateral([&](int i) { return points_of(points)[i]; },
                                      [&](int i) { return weights.data()[i]; }, static_cast<int>(points.shape(0)));
    return nb::make_tuple(q.index[0], q.index[1], q.index[2], q.index[3], q.triangle);
}

nb::tuple py_select_points(const PointArray &points, const ValueArray &arc, const ValueArray &values,
                           double separation, double prominence) {
    check_arc(points.shape(0), arc);
    check_arc(values.shape(0), arc);
    const Selected selected = select_points(points_of(points), arc.data(), values.data(), separation, prominence);
    return nb::make_tuple(selected.peaks, selected.triangle);
}

nb::list py_align_outlines(const PointArray &points1, const ValueArray &arc1, const PointArray &points2,
                           const ValueArray &arc2, std::int64_t count, double tie) {
    if (count < 4 || (count & (count - 1)) != 0)
        throw std::invalid_argument("count must be a power of 2, at least 4, not " + std::to_string(count));
    check_arc(points1.shape(0), arc1);
    check_arc(points2.shape(0), arc2);
    nb::list out;
    for (const Fit &fit : align_outlines(points_of(points1), arc1.data(), points_of(points2), arc2.data(),
                                         static_cast<std::size_t>(count), tie))
        out.append(nb::make_tuple(fit.shift, fit.angle, fit.residual));
    return out;
}

nb::tuple py_match_curvature(const ValueArray &v1, const ValueArray &arc1, const std::vector<std::int64_t> &indices,
                             const ValueArray &v2, const ValueArray &arc2, const std::vector<double> &centres,
                             double kappa, double reach, int radius, double step, double tolerance) {
    check_arc(v1.shape(0), arc1);
    check_arc(v2.shape(0), arc2);
    check_indices(indices, v1.shape(0));
    if (radius < 0) throw std::invalid_argument("radius must be at least 0");
    if (centres.size() != indices.size()) throw std::invalid_argument("each index needs its centre");
    nb::list samples, errors;
    for (const Match &match : match_curvature(
             {v1.data(), arc1.data(), static_cast<std::int64_t>(v1.shape(0))}, indices,
             {v2.data(), arc2.data(), static_cast<std::int64_t>(v2.shape(0))}, centres, kappa, reach, radius, step,
             tolerance)) {
        samples.append(match.sample);
        errors.append(match.error);
    }
    return nb::make_tuple(samples, errors);
}

}  // namespace

NB_MODULE(_native, m) {
    m.doc() = "Compiled kernels; grasptrack.kernels.reference defines each of them.";
    m.def("align_outlines", &py_align_outlines, "points1"_a, "arc1"_a, "points2"_a, "arc2"_a, "count"_a,
          "tie"_a);
    m.def("arc_length", &py_arc_length, "points"_a);
    m.def("best_quadrilateral", &py_best_quadrilateral, "points"_a, "weights"_a);
    m.def("blend_normals", &py_blend_normals, "points"_a);
    m.def("carry_grasp_line", &py_carry_grasp_line, "points"_a, "offsets"_a, "line"_a, "reference"_a, "ahead"_a,
          "least_skewness"_a);
    m.def("carry_places", &py_carry_places, "places"_a, "offsets"_a, "points"_a, "current"_a);
    m.def("contact_frames", &py_contact_frames, "points"_a, "offsets"_a, "places"_a, "width"_a);
    m.def("crossings", &py_crossings, "points"_a, "offsets"_a, "x"_a, "y"_a, "ux"_a, "uy"_a);
    m.def("curvature", &py_curvature, "points"_a, "step"_a);
    m.def("curvature_peaks", &py_curvature_peaks, "curvature"_a, "arc"_a, "separation"_a, "prominence"_a);
    m.def("curvature_vector", &py_curvature_vector, "points"_a, "clipped"_a.none(), "smoothing"_a);
    m.def("carry_points", &py_carry_points, "H"_a, "points"_a);
    m.def("distortion", &py_distortion, "H"_a, "points"_a);
    m.def("fit_homography", &py_fit_homography, "points1"_a, "indices1"_a, "points2"_a, "indices2"_a);
    m.def("fixed_places", &py_fixed_places, "points"_a, "offsets"_a, "queries"_a);
    m.def("force_closure", &py_force_closure, "contacts"_a, "normals"_a, "cx"_a, "cy"_a, "rho"_a, "friction"_a);
    m.def("grasp_line", &py_grasp_line, "points"_a, "offsets"_a, "contacts"_a);
    m.def("homography_4", &py_homography_4, "source"_a, "target"_a);
    m.def("inertia", &py_inertia, "points"_a, "offsets"_a);
    m.def("locate", &py_locate, "points"_a, "offsets"_a, "queries"_a);
    m.def("match_curvature", &py_match_curvature, "v1"_a, "arc1"_a, "indices"_a, "v2"_a, "arc2"_a, "centres"_a,
          "kappa"_a, "reach"_a, "radius"_a, "step"_a, "tolerance"_a);
    m.def("nearest_crossings", &py_nearest_crossings, "points"_a, "offsets"_a, "x"_a, "y"_a, "ux"_a, "uy"_a, "t1"_a,
          "t2"_a);
    m.def("point_at", &py_point_at, "points"_a, "offsets"_a, "places"_a);
    m.def("refine_contacts", &py_refine_contacts, "H"_a, "contacts"_a, "normals"_a.none(), "points"_a, "offsets"_a);
    m.def("resample", &py_resample, "points"_a, "count"_a, "smooth"_a);
    m.def("select_points", &py_select_points, "points"_a, "arc"_a, "curvature"_a, "separation"_a, "prominence"_a);
    bind_images(m);
    bind_match(m);
    bind_grasp(m);
    bind_servo(m);
    bind_pose(m);
}
