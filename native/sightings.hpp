// SPDX-License-Identifier: Apache-2.0
// What a camera on a hand sees of points on a plane that may move, and the derivatives by everything that is unknown.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace grasptrack {

using Mat3 = std::array<double, 9>;

// Where in a state: focal length, centre, the camera's turn and offset; the object's turn, place, speed, axes, points.
namespace state {
constexpr std::size_t focal = 0, centre = 1, turn = 3, offset = 12, pose = 15, place = 24, speed = 27, axes = 30,
                      points = 39;
}

// Where in a step of all unknowns: as above, but the centre and the axes are none.
namespace unknown {
constexpr std::size_t focal = 0, turn = 1, offset = 4, place = 7, pose = 10, speed = 13, shape = 16, own = 18;
}

constexpr double nearest_seen = 1e-3;  // m in front of the camera

// The rotation about v by its length in rad (Rodrigues).
inline Mat3 rotation(const double *v) {
    const double angle = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    const double a = angle < 1e-6 ? 1.0 : std::sin(angle) / angle;
    const double b = angle < 1e-6 ? 0.5 : (1.0 - std::cos(angle)) / (angle * angle);
    const double K[9] = {0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0};
    Mat3 R{};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            double square = 0.0;
            for (int k = 0; k < 3; ++k) square += K[3 * i + k] * K[3 * k + j];
            R[3 * i + j] = (i == j ? 1.0 : 0.0) + a * K[3 * i + j] + b * square;
        }
    return R;
}

// Its inverse, of first' second.
inline void rotation_between(const double *first, const double *second, double *v) {
    Mat3 R{};
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) R[3 * i + j] += first[3 * k + i] * second[3 * k + j];
    const double axis[3] = {R[7] - R[5], R[2] - R[6], R[3] - R[1]};
    const double sine = 0.5 * std::sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    const double angle = std::atan2(sine, 0.5 * (R[0] + R[4] + R[8] - 1.0));
    for (int i = 0; i < 3; ++i) v[i] = 0.5 * axis[i] * (sine > 1e-9 ? angle / sine : 1.0);
}

// A state after a step of all unknowns.
inline void stepped(const double *from, const double *step, std::size_t n, double *to) {
    std::copy(from, from + state::points + 2 * n, to);
    to[state::focal] = from[state::focal] * std::exp(std::clamp(step[unknown::focal], -0.5, 0.5));
    for (int i = 0; i < 3; ++i) {
        to[state::offset + i] += step[unknown::offset + i];
        to[state::place + i] += step[unknown::place + i];
        to[state::speed + i] += step[unknown::speed + i];
    }
    for (std::size_t i = 0; i < 2 * n; ++i) to[state::points + i] += step[unknown::shape + i];
    const auto turned = [&](std::size_t at, const double *by) {
        const Mat3 R = rotation(by);
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                double sum = 0.0;
                for (int k = 0; k < 3; ++k) sum += from[at + 3 * i + k] * R[3 * k + j];
                to[at + 3 * i + j] = sum;
            }
    };
    turned(state::turn, step + unknown::turn);
    turned(state::pose, step + unknown::pose);
}

// The step that takes one state to another.
inline void difference(const double *from, const double *to, std::size_t n, double *step) {
    step[unknown::focal] = std::log(to[state::focal] / from[state::focal]);
    rotation_between(from + state::turn, to + state::turn, step + unknown::turn);
    rotation_between(from + state::pose, to + state::pose, step + unknown::pose);
    for (int i = 0; i < 3; ++i) {
        step[unknown::offset + i] = to[state::offset + i] - from[state::offset + i];
        step[unknown::place + i] = to[state::place + i] - from[state::place + i];
        step[unknown::speed + i] = to[state::speed + i] - from[state::speed + i];
    }
    for (std::size_t i = 0; i < 2 * n; ++i)
        step[unknown::shape + i] = to[state::points + i] - from[state::points + i];
}

// One point as a hand's camera sees it.
struct Seen {
    double P[3];   // m, in the camera's frame
    double at[2];  // px, NaN behind the camera

    // hand: a pose (4, 4); later: s after the time of the state.
    Seen(const double *s, const double *hand, double later, std::size_t i) {
        const double x = s[state::points + 2 * i], y = s[state::points + 2 * i + 1];
        double from_hand[3], in_hand[3];
        for (int r = 0; r < 3; ++r) {
            const double *T = s + state::pose + 3 * r, *a = s + state::axes + 3 * r, *v = s + state::speed;
            from_hand[r] = T[0] * x + T[1] * y + s[state::place + r] +
                           later * (a[0] * v[0] + a[1] * v[1] + a[2] * v[2]) - hand[4 * r + 3];
        }
        for (int c = 0; c < 3; ++c)
            in_hand[c] = from_hand[0] * hand[c] + from_hand[1] * hand[4 + c] + from_hand[2] * hand[8 + c] -
                         s[state::offset + c];
        const double *C = s + state::turn;
        for (int c = 0; c < 3; ++c) P[c] = in_hand[0] * C[c] + in_hand[1] * C[3 + c] + in_hand[2] * C[6 + c];
        const bool seen = P[2] > nearest_seen;
        for (int r = 0; r < 2; ++r)
            at[r] = seen ? s[state::focal] * P[r] / P[2] + s[state::centre + r]
                         : std::numeric_limits<double>::quiet_NaN();
    }

    // Derivatives, two rows of 18: by the 16 unknowns that all points share, then by the point's own x and y.
    void slopes(const double *s, const double *hand, double later, std::size_t i, double (*out)[unknown::own]) const {
        const double x = s[state::points + 2 * i], y = s[state::points + 2 * i + 1];
        const double *C = s + state::turn, *T = s + state::pose, *axes = s + state::axes;
        for (int r = 0; r < 2; ++r) {
            double a[3] = {0.0, 0.0, -s[state::focal] * P[r] / (P[2] * P[2])};
            a[r] = s[state::focal] / P[2];
            double *row = out[r];
            row[unknown::focal] = at[r] - s[state::centre + r];
            row[unknown::turn] = a[1] * P[2] - a[2] * P[1];
            row[unknown::turn + 1] = a[2] * P[0] - a[0] * P[2];
            row[unknown::turn + 2] = a[0] * P[1] - a[1] * P[0];
            double in_hand[3], *in_base = row + unknown::place, in_plane[3];
            for (int j = 0; j < 3; ++j) {
                in_hand[j] = a[0] * C[3 * j] + a[1] * C[3 * j + 1] + a[2] * C[3 * j + 2];
                row[unknown::offset + j] = -in_hand[j];
            }
            for (int j = 0; j < 3; ++j)
                in_base[j] = in_hand[0] * hand[4 * j] + in_hand[1] * hand[4 * j + 1] + in_hand[2] * hand[4 * j + 2];
            for (int j = 0; j < 3; ++j) {
                in_plane[j] = in_base[0] * T[j] + in_base[1] * T[3 + j] + in_base[2] * T[6 + j];
                row[unknown::speed + j] =
                    later * (in_base[0] * axes[j] + in_base[1] * axes[3 + j] + in_base[2] * axes[6 + j]);
            }
            row[unknown::pose] = in_plane[2] * y;
            row[unknown::pose + 1] = -in_plane[2] * x;
            row[unknown::pose + 2] = in_plane[1] * x - in_plane[0] * y;
            row[unknown::shape] = in_plane[0], row[unknown::shape + 1] = in_plane[1];
        }
    }
};

// Column of a whole step for one of a point's own 18.
inline std::size_t column(std::size_t own, std::size_t i) { return own < unknown::shape ? own : own + 2 * i; }

}  // namespace grasptrack
