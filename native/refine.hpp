// SPDX-License-Identifier: Apache-2.0
// Contacts carried by a homography and moved onto the outline (Fig. 11). Defined in kernels/reference_refine.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "lines.hpp"

namespace grasptrack {

// Eq. (2) about one point: where it goes, the derivatives there, and lambda.
struct Local {
    Vec at;
    double xx, xy, yx, yy, lambda;
};

inline Local local(const double *H, Vec p) {
    const double w = H[6] * p.x + H[7] * p.y + H[8];
    const double u = (H[0] * p.x + H[1] * p.y + H[2]) / w, v = (H[3] * p.x + H[4] * p.y + H[5]) / w;
    return {{u, v}, (H[0] - H[6] * u) / w, (H[1] - H[7] * u) / w, (H[3] - H[6] * v) / w, (H[4] - H[7] * v) / w, w};
}

struct Refined {
    double residual = 0.0, growth = 0.0, in_front = std::numeric_limits<double>::infinity();

    void moved(Vec by) {
        const double distance = length(by);
        if (!(distance <= residual)) residual = distance;  // a NaN stays
    }
};

// normals is null for two contacts, which move along their line.
inline Refined refine_contacts(const double *H, Points contacts, const Vec *normals, const Outline &outline, Vec *out) {
    Refined result;
    double side = 0;
    for (std::size_t i = 0; i < contacts.size; ++i) {
        const Local carried = local(H, contacts[i]);
        out[i] = carried.at;
        if (i == 0) {
            side = carried.lambda < 0 ? -1 : 1;
            result.growth = std::sqrt(std::fabs(carried.xx * carried.yy - carried.xy * carried.yx));
        }
        if (!(side * carried.lambda >= result.in_front)) result.in_front = side * carried.lambda;
        if (!normals) continue;
        // Normals go by the inverse transpose, up to scale.
        const Vec n = normals[i];
        Vec along{carried.yy * n.x - carried.yx * n.y, carried.xx * n.y - carried.xy * n.x};
        along = (1 / length(along)) * along;
        Nearest nearest{0};
        for_each_crossing(outline, {out[i], along}, [&](std::size_t, double, double t) { nearest.offer(t); });
        out[i] = out[i] + nearest.t * along;
        if (!std::isnan(result.residual)) result.moved(nearest.t * along);
    }
    if (normals) return result;
    const double opening = length(out[1] - out[0]);
    const Vec along = (1 / opening) * (out[1] - out[0]);
    Nearest a{0}, b{opening};
    for_each_crossing(outline, {out[0], along}, [&](std::size_t, double, double t) { a.offer(t), b.offer(t); });
    result.residual = std::max(std::fabs(a.t), std::fabs(b.t - opening));
    if (std::isnan(a.t)) result.residual = a.t;
    if (a.t == b.t) result.residual = std::numeric_limits<double>::infinity();
    out[1] = out[0] + b.t * along;
    out[0] = out[0] + a.t * along;
    return result;
}

}  // namespace grasptrack
