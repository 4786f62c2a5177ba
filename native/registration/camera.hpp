// SPDX-License-Identifier: Apache-2.0
// What a pinhole lets a rigid plane do in the image, and where the lower face of a thick part shows.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "target.hpp"

namespace grasptrack::pose {

// What is not known of camera and part: the part's thickness in work px, and theta.
constexpr std::size_t nuisances = 4;
using Nuisance = Vector<nuisances>;
constexpr double pose_step = 0.1, camera_step = 1e-3;  // of the differences that stand for derivatives: work px, and units of theta
constexpr double most_theta = 1.2;  // of the log of the focal length, and of the normal's slopes: a view beyond it is not believable

using Direction = std::array<double, 3>;

inline Direction cross(const Direction &a, const Direction &b) {
    return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline double dot(const Direction &a, const Direction &b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
inline Direction unit(const Direction &a) {
    const double s = 1.0 / std::sqrt(dot(a, a));
    return {a[0] * s, a[1] * s, a[2] * s};
}

// px of an image, and how wide one is for each unit of its height.
struct Frame {
    double width, height, aspect;
};

// theta = (log of the focal length in image widths, and the first view's normal (theta_1, theta_2, 1)).
class Pinhole {
  public:
    Pinhole(const Target &target, const Vector<3> &theta, const Frame &frame) {
        const Taught taught = target.taught.value_or(Taught{frame.width, frame.width / 2, frame.height / 2});
        const double f = taught.width * std::exp(theta[0]);
        now_ = Lens(frame.width * std::exp(theta[0]), frame.aspect, frame.width / 2, frame.height / 2);
        first_ = Lens(f, frame.aspect, taught.x, taught.y);
        const Direction n = unit({theta[1], theta[2], 1.0});
        const Direction first = unit({n[2], 0, -n[0]}), second = cross(n, first);
        const double cx = target.cx, cy = target.cy;
        const Homography &A = target.A;
        const Vector<3> at{A[0] * cx + A[1] * cy + A[2], A[3] * cx + A[4] * cy + A[5], A[6] * cx + A[7] * cy + A[8]};
        const Vector<3> ray = times<3>(first_.back, at);
        const double depth = 1.0 / dot(n, ray);
        const Direction p{ray[0] * depth, ray[1] * depth, ray[2] * depth};
        const Homography plane{first[0], second[0], p[0], first[1], second[1], p[1], first[2], second[2], p[2]};
        unit_ = p[2] / f * A[0];  // A[0]: reference px per work px
        Homography inverse{};
        valid_ = invert_homography(A, inverse) && depth > 0;
        to_work_ = times<3>(inverse, times<3>(first_.K, plane));
        valid_ = valid_ && invert_homography(to_work_, from_work_);
    }

    bool valid() const { return valid_; }

    // The plane's axes and the target's middle in the current camera, as columns.
    Homography posed(const Homography &G) const { return times<3>(now_.back, times<3>(G, to_work_)); }

    // Both 0 where G is a view of a rigid plane: cosine of the angle of the axes, and log of the ratio of their lengths.
    std::array<double, 2> misfit(const Homography &G) const {
        const Homography B = posed(G);
        const Direction a{B[0], B[3], B[6]}, b{B[1], B[4], B[7]};
        const double la = std::sqrt(dot(a, a)), lb = std::sqrt(dot(b, b));
        return {dot(a, b) / (la * lb), std::log(la / lb)};
    }

    // Work px by which the lower face's outline lies outside the upper one's at each sample, for each work px of thickness.
    std::vector<double> lower_face(const Target &target, const Homography &G) const { return lower_face_by(now_, target, G); }
    std::vector<double> first_lower_face(const Target &target) const { return lower_face_by(first_, target, target.A); }

  private:
    struct Lens {
        Homography K{}, back{};
        Lens() = default;
        Lens(double f, double aspect, double x, double y)
            : K{f, 0, x, 0, f * aspect, y, 0, 0, 1}, back{1 / f, 0, -x / f, 0, 1 / (f * aspect), -y / (f * aspect), 0, 0, 1} {}
    };

    std::vector<double> lower_face_by(const Lens &lens, const Target &target, const Homography &G) const {
        const std::size_t n = target.points.size();
        std::vector<double> out(n, 0.0);
        Homography B = times<3>(lens.back, times<3>(G, to_work_)), inverse;
        if (!valid_ || !invert_homography(G, inverse)) return out;
        double length = 0;
        for (std::size_t k = 0; k < 2; ++k)
            length += 0.5 * std::sqrt(B[k] * B[k] + B[3 + k] * B[3 + k] + B[6 + k] * B[6 + k]);
        const double sign = B[8] < 0 ? -1.0 : 1.0;
        for (double &value : B) value *= sign / length;
        Direction down = unit(cross({B[0], B[3], B[6]}, {B[1], B[4], B[7]}));
        if (dot(down, {B[2], B[5], B[8]}) < 0) down = {-down[0], -down[1], -down[2]};
        constexpr double step = 5.0;  // work px, of the finite difference
        const Homography view = times<3>(inverse, lens.K);
        for (std::size_t i = 0; i < n; ++i) {
            const Point p = target.points[i], m = target.normals[i];
            const Vector<3> at = times<3>(from_work_, Vector<3>{p.x, p.y, 1.0});
            const Vector<3> X = times<3>(B, Vector<3>{at[0] / at[2], at[1] / at[2], 1.0});
            const double t = step * unit_;
            const Vector<3> y = times<3>(view, Vector<3>{X[0] + t * down[0], X[1] + t * down[1], X[2] + t * down[2]});
            const double offset = (y[0] / y[2] - p.x) * m.x + (y[1] / y[2] - p.y) * m.y;
            out[i] = std::isfinite(offset) ? std::max(offset, 0.0) / step : 0.0;
        }
        return out;
    }

    double unit_;
    bool valid_;
    Lens now_, first_;  // of the image that is looked at, and of the reference image
    Homography to_work_, from_work_;
};

struct PinholeRows {
    bool valid = false;
    std::array<double, 2> misfit{std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()};
    std::array<Vector<8>, 2> by_pose{};
    std::array<Vector<3>, 2> by_camera{};
};

inline PinholeRows pinhole_rows(const Target &target, const Homography &G, const Vector<3> &theta, const Frame &frame) {
    PinholeRows rows;
    const Pinhole camera(target, theta, frame);
    if (!camera.valid()) return rows;
    rows.misfit = camera.misfit(G);
    for (std::size_t i = 0; i < 8; ++i) {
        Vector<8> d{};
        d[i] = pose_step;
        const auto there = camera.misfit(target.moved(G, d));
        for (std::size_t k = 0; k < 2; ++k) rows.by_pose[k][i] = (there[k] - rows.misfit[k]) / pose_step;
    }
    for (std::size_t i = 0; i < 3; ++i) {
        Vector<3> other = theta;
        other[i] += camera_step;
        const auto there = Pinhole(target, other, frame).misfit(G);
        for (std::size_t k = 0; k < 2; ++k) rows.by_camera[k][i] = (there[k] - rows.misfit[k]) / camera_step;
    }
    rows.valid = std::isfinite(rows.misfit[0]) && std::isfinite(rows.misfit[1]);
    return rows;
}

}  // namespace grasptrack::pose
