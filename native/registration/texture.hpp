// SPDX-License-Identifier: Apache-2.0
// Texture: small patches of one look laid on another, each saying by how much the pose is off, and how surely.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "matrix.hpp"
#include "pyramid.hpp"
#include "target.hpp"

namespace grasptrack::pose {

// Grey levels, of the camera's noise in pixels `stride` apart: halving an image leaves little more than a quarter of it, halving
// it again the half of that. At least that of 8 bits.
inline double noise_of(double camera, double stride) {
    return stride > 1 ? std::max(camera / (2 * stride), std::sqrt(1.0 / 12)) : camera;
}

// Of the sum of squares of Scharr's gradients `stride` apart along an axis, what noise alone gives twice.
inline double alone_of(double noise, double stride) { return 236.0 / 512 * patch_pixels * noise * noise / (stride * stride); }

constexpr int within_pixels = (patch_side - 2) * (patch_side - 2);

// Sums of squares of Scharr's gradients of a patch's inner pixels along the axis (cosine, sine) and across it, per work px^2.
GRASPTRACK_WITHIN std::array<double, 2> power_within(const double *value, double stride, double cosine, double sine) {
    constexpr int first = patch_side + 1, end = patch_pixels - first;
    double xs[patch_pixels], ys[patch_pixels];
    for (int k = first; k < end; ++k) {  // those of the border as well, without a break
        const double *here = value + k, *above = here - patch_side, *below = here + patch_side;
        xs[k] = 10 * (here[1] - here[-1]) + 3 * (above[1] - above[-1] + below[1] - below[-1]);
        ys[k] = 10 * (below[0] - above[0]) + 3 * (below[-1] - above[-1] + below[1] - above[1]);
    }
    double xx = 0, xy = 0, yy = 0;
    for (int j = 1; j + 1 < patch_side; ++j)
        for (int i = 1; i + 1 < patch_side; ++i) {
            const double x = xs[j * patch_side + i], y = ys[j * patch_side + i];
            xx += x * x;
            xy += x * y;
            yy += y * y;
        }
    const double c2 = cosine * cosine, s2 = sine * sine, mixed = 2 * cosine * sine * xy, square = 1 / (1024 * stride * stride);
    return {square * (c2 * xx + mixed + s2 * yy), square * (s2 * xx - mixed + c2 * yy)};
}

// Sums over a patch of products of two kinds of gradients (xx, xy, yx, yy), by pixels from the middle.
struct Moments {
    double plain[4], x[4], y[4], xx[4], xy[4], yy[4];
};

// What a pose's error changes of the shift that a patch tells, by the places of all its pixels. `all`: of its own gradients and
// those that light was not taken out of.
// A turn of the pose turns the patch as well, which its gradients take for a shift: the arc of a disc, that comes to lie on
// itself, tells nothing of how far it turned.
inline void set_rows(const Target &target, double stride, const Moments &all, Patch &patch) {
    const double p = (patch.x - target.cx) / target.radius, q = (patch.y - target.cy) / target.radius, e = stride / target.radius;
    const auto J = target.jacobian(patch.x, patch.y);
    const double alone = alone_of(noise_of(target.noise, stride), stride);
    const double shared = 0.5 * alone;  // of both kinds of gradients, by the same noise
    patch.rows = {};
    for (std::size_t axis = 0; axis < 2; ++axis) {
        const double ux = axis == 0 ? patch.cosine : -patch.sine, uy = axis == 0 ? patch.sine : patch.cosine;
        const auto of = [&](const double *m, int k) { return ux * m[k] + uy * m[2 + k]; };
        Vector<8> change;
        double quadratic[2][2][2];  // by sx or sy, of p p, p q, and q q
        for (int k = 0; k < 2; ++k) {
            const double one = of(all.plain, k), i = e * of(all.x, k), j = e * of(all.y, k);
            const auto at = static_cast<std::size_t>(k);
            change[at] = one;
            change[2 + 2 * at] = p * one + i;
            change[3 + 2 * at] = q * one + j;
            quadratic[k][0][0] = p * p * one + 2 * p * i + e * e * of(all.xx, k);
            quadratic[k][0][1] = quadratic[k][1][0] = p * q * one + p * j + q * i + e * e * of(all.xy, k);
            quadratic[k][1][1] = q * q * one + 2 * q * j + e * e * of(all.yy, k);
        }
        change[6] = quadratic[0][0][0] + quadratic[1][0][1];
        change[7] = quadratic[0][1][0] + quadratic[1][1][1];
        const double shift = ux * change[0] + uy * change[1] - shared;
        if (!(patch.power[axis] > alone && shift > 0)) continue;
        for (std::size_t a = 0; a < 8; ++a) {
            const double row = (change[a] - shared * (ux * J[0][a] + uy * J[1][a])) / shift;
            patch.rows[0][a] += ux * row;
            patch.rows[1][a] += uy * row;
        }
    }
}

// Whether a level holds a square about c, of which (ux, uy) and (vx, vy) are halves of the sides.
inline bool holds_square(const Level &level, Point c, double ux, double uy, double vx, double vy) {
    const int step = level.hidden ? 1 : 2;  // of what has no holes the corners are enough
    for (int s = -1; s <= 1; s += step)
        for (int t = -1; t <= 1; t += step)
            if (!level.holds(c.x + s * ux + t * vx, c.y + s * uy + t * vy, 1.0)) return false;
    return true;
}

// A patch of an image seen through G; false where it is not whole in view.
GRASPTRACK_WIDE inline bool cut_patch(const Target &target, const Pyramid &pyramid, const Homography &G, double x, double y, double stride,
                      Patch &out) {
    const SeenPoint seen = look_at(pyramid, G, {x, y}, stride);
    const Point c = seen.at;
    const auto &d = seen.by;
    constexpr int half = patch_side / 2 + 1, side = patch_side + 2;
    const double ux = d[0] * stride, uy = d[2] * stride, vx = d[1] * stride, vy = d[3] * stride;
    if (!holds_square(*seen.level, c, half * ux, half * uy, half * vx, half * vy)) return false;
    double value[side][side], at_x[side * side], at_y[side * side];
    for (int j = 0; j < side; ++j)
        for (int i = 0; i < side; ++i) {
            at_x[j * side + i] = c.x + (i - half) * ux + (j - half) * vx;
            at_y[j * side + i] = c.y + (i - half) * uy + (j - half) * vy;
        }
    seen.level->at(at_x, at_y, side * side, value[0]);
    out.x = x;
    out.y = y;
    const double units = 1 / (32 * stride);
    double mean = 0, mx = 0, my = 0, sx[patch_pixels], sy[patch_pixels];
    for (int j = 0; j < patch_side; ++j)
        for (int i = 0; i < patch_side; ++i) {
            const auto k = static_cast<std::size_t>(j * patch_side + i);
            const double v = value[j + 1][i + 1];
            // Scharr's gradients: plain differences turn those of a sharp edge by some degrees, here and there otherwise, which
            // looks like texture along it
            const double *above = value[j] + i, *here = value[j + 1] + i, *below = value[j + 2] + i;
            sx[k] = units * (10 * (here[2] - here[0]) + 3 * (above[2] - above[0] + below[2] - below[0]));
            sy[k] = units * (10 * (below[1] - above[1]) + 3 * (below[0] - above[0] + below[2] - above[2]));
            out.value[k] = static_cast<float>(v);
            mean += v;
            mx += sx[k];
            my += sy[k];
        }
    mean /= patch_pixels;
    mx /= patch_pixels;
    my /= patch_pixels;
    out.axx = out.axy = out.ayy = out.variance = 0;
    double tx = 0, ty = 0;
    for (std::size_t k = 0; k < patch_pixels; ++k) {
        out.value[k] -= static_cast<float>(mean);
        const double v = out.value[k];
        out.variance += v * v;
        tx += v * sx[k];
        ty += v * sy[k];
    }
    // Bias and gain are free: only what a shift changes otherwise tells of it. (The tail of a blurred edge, shifted, is
    // the same tail with another gain.)
    const double s = out.variance > 0 ? 1 / out.variance : 0;
    Moments all{};
    for (int j = 0, k = 0; j < patch_side; ++j) {
        double plain[4] = {}, once[4] = {}, twice[4] = {};
        for (int i = 0; i < patch_side; ++i, ++k) {
            const auto at = static_cast<std::size_t>(k);
            const double v = out.value[at], gx = sx[at] - mx - s * tx * v, gy = sy[at] - my - s * ty * v;
            out.gx[at] = static_cast<float>(gx);
            out.gy[at] = static_cast<float>(gy);
            out.axx += gx * gx;
            out.axy += gx * gy;
            out.ayy += gy * gy;
            const double product[4] = {gx * sx[at], gx * sy[at], gy * sx[at], gy * sy[at]}, along = i - patch_side / 2;
            for (int m = 0; m < 4; ++m) {
                plain[m] += product[m];
                once[m] += along * product[m];
                twice[m] += along * along * product[m];
            }
        }
        const double down = j - patch_side / 2;
        for (int m = 0; m < 4; ++m) {
            all.plain[m] += plain[m];
            all.x[m] += once[m];
            all.xx[m] += twice[m];
            all.y[m] += down * plain[m];
            all.xy[m] += down * once[m];
            all.yy[m] += down * down * plain[m];
        }
    }
    // the two axes of the gradients, each with what it holds of them
    const double half_mean = 0.5 * (out.axx + out.ayy), root = std::hypot(0.5 * (out.axx - out.ayy), out.axy);
    const double angle = 0.5 * std::atan2(2 * out.axy, out.axx - out.ayy);
    out.cosine = std::cos(angle);
    out.sine = std::sin(angle);
    out.power = {half_mean + root, half_mean - root};
    double middle_of[patch_pixels];
    std::copy(out.value.begin(), out.value.end(), middle_of);
    out.within = power_within(middle_of, stride, out.cosine, out.sine);
    set_rows(target, stride, all, out);
    return true;
}

struct PatchMatch {
    bool inside = false;
    double correlation = 0;       // with the camera's noise in the denominator
    double dx = 0, dy = 0;        // work px, by which the pose is off there
    double wxx = 0, wxy = 0, wyy = 0;  // information about it, per work px^2
};

struct TextureNumbers {
    double floor;       // work px, model error of a patch
    double independent;  // patches that carry one independent measurement
    double freedom;     // of the t distribution of their errors
};

// Where the pixels of a patch are on an image seen through G.
struct Lattice {
    const Level *level;
    double x[patch_pixels], y[patch_pixels];

    // False where it is not whole in view.
    GRASPTRACK_WITHIN bool lay(const Pyramid &pyramid, const Homography &G, Point place, double stride) {
        const SeenPoint seen = look_at(pyramid, G, place, stride);
        const Point c = seen.at;
        const auto &d = seen.by;
        constexpr int half = patch_side / 2;
        const double ux = d[0] * stride, uy = d[2] * stride, vx = d[1] * stride, vy = d[3] * stride;
        level = seen.level;
        if (!holds_square(*level, c, half * ux, half * uy, half * vx, half * vy)) return false;
        for (int j = -half, k = 0; j <= half; ++j)
            for (int i = -half; i <= half; ++i, ++k) {
                x[k] = c.x + i * ux + j * vx;
                y[k] = c.y + i * uy + j * vy;
            }
        return true;
    }
};

// One patch on an image seen through G, about the place where its middle is expected.
GRASPTRACK_WIDE inline PatchMatch match_patch(const Pyramid &pyramid, const Homography &G, const Patch &patch, Point place, double stride,
                              double camera, double floor) {
    PatchMatch out;
    const double noise = noise_of(camera, stride);
    Lattice lattice;
    if (!lattice.lay(pyramid, G, place, stride)) return out;
    double value[patch_pixels];
    lattice.level->at(lattice.x, lattice.y, patch_pixels, value);
    constexpr int parts = 4, even = patch_pixels / parts * parts;
    double sum[parts] = {};
    for (int i = 0; i < even; i += parts)
        for (int p = 0; p < parts; ++p) sum[p] += value[i + p];
    for (int i = even; i < patch_pixels; ++i) sum[0] += value[i];
    const double mean = (sum[0] + sum[1] + sum[2] + sum[3]) / patch_pixels;
    double varied[patch_pixels];
    for (int i = 0; i < patch_pixels; ++i) varied[i] = value[i] - mean;
    const auto against = [&](const std::array<float, patch_pixels> &other) {
        double wide[patch_pixels];
        std::copy(other.begin(), other.end(), wide);
        return sum_of_products<patch_pixels>(varied, wide);
    };
    const double own = sum_of_products<patch_pixels>(varied, varied), cross = against(patch.value);
    const double ex = against(patch.gx), ey = against(patch.gy);
    out.inside = true;
    const double grain = patch_pixels * noise * noise;
    out.correlation = cross / std::sqrt((own + grain) * (patch.variance + grain));
    const double gain = std::clamp(std::sqrt(std::max(own - grain, 0.0) / std::max(patch.variance, 1e-9)), 0.2, 5.0);
    // Along each of the two axes of the patch's gradients: what noise alone gives of them tells nothing.
    const double cosine = patch.cosine, sine = patch.sine;
    const double alone = alone_of(noise, stride);
    double rest = own - 2 * gain * cross + gain * gain * patch.variance;
    double offset[2], information[2];
    const auto within = power_within(value, stride, cosine, sine);
    const double noise_within = 0.5 * alone * within_pixels / patch_pixels;
    for (int axis = 0; axis < 2; ++axis) {
        const double ux_ = axis == 0 ? cosine : -sine, uy_ = axis == 0 ? sine : cosine;
        const double all = patch.power[static_cast<std::size_t>(axis)], signal = all - alone;
        const double e = ux_ * ex + uy_ * ey;
        offset[axis] = information[axis] = 0;
        if (!(signal > 0)) continue;
        // noise in the gradients shortens a shift measured with them
        offset[axis] = std::clamp(-e / (signal * gain), -2.5 * stride, 2.5 * stride);
        information[axis] = gain * gain * signal * signal / all;
        // what has no such gradients any more does not tell: a highlight's rim that is gone would tell all along streaks, where
        // nothing else tells anything
        const auto at = static_cast<std::size_t>(axis);
        const double before = gain * gain * (patch.within[at] - noise_within), now = within[at] - noise_within;
        if (before > 0 && now < before) information[axis] *= std::max(0.0, now / before);
        rest -= e * e / all;
    }
    const double s2 = std::max(rest, 0.0) / (patch_pixels - 4) + noise * noise;
    for (double &value : information) value = value > 0 ? 1.0 / (s2 / value + floor * floor) : 0.0;
    out.dx = cosine * offset[0] - sine * offset[1];
    out.dy = sine * offset[0] + cosine * offset[1];
    out.wxx = cosine * cosine * information[0] + sine * sine * information[1];
    out.wyy = sine * sine * information[0] + cosine * cosine * information[1];
    out.wxy = cosine * sine * (information[0] - information[1]);
    return out;
}

struct TextureFit {
    Matrix<8> information{};
    Vector<8> gradient{};  // information times the error d
    int used = 0;          // patches in view
    double agreeing = 0;   // share of all patches that agree with the fit
    double spread = 0;     // median error, in predicted standard deviations
    std::vector<double> weight;  // by which each patch's information counts
};

// Whether so many of n patches agree that it is not by chance: noise alone agrees here and there.
inline bool is_no_chance(double agreeing, std::size_t n) { return agreeing >= 4 + 0.12 * static_cast<double>(n); }

inline bool tells(const TextureFit &fit, std::size_t count) {
    return fit.used >= 4 && is_no_chance(fit.agreeing * static_cast<double>(count), count);
}

// The same where all patches share an error of the pose with these variances: N becomes (N^-1 + L)^-1.
inline void share_error(TextureFit &fit, const Vector<8> &variances) {
    if (std::all_of(variances.begin(), variances.end(), [](double v) { return v == 0; })) return;
    Matrix<8> inner, inverse, left;  // 1 + D N D and N D, D being the standard deviations
    for (std::size_t i = 0; i < 8; ++i)
        for (std::size_t j = 0; j < 8; ++j) {
            left[i * 8 + j] = fit.information[i * 8 + j] * std::sqrt(variances[j]);
            inner[i * 8 + j] = (i == j ? 1.0 : 0.0) + std::sqrt(variances[i]) * left[i * 8 + j];
        }
    if (!invert<8>(inner, inverse)) return;
    const Matrix<8> gain = times<8>(left, inverse), taken = times<8>(gain, transposed<8>(left));
    Vector<8> pulled;
    for (std::size_t i = 0; i < 8; ++i) pulled[i] = std::sqrt(variances[i]) * fit.gradient[i];
    const Vector<8> less = times<8>(gain, pulled);
    for (std::size_t k = 0; k < 64; ++k) fit.information[k] -= taken[k];
    for (std::size_t k = 0; k < 8; ++k) fit.gradient[k] -= less[k];
}

constexpr double agreeing = 0.5;  // correlation of what shows the same

// A patch with what it says.
struct PatchRow {
    const Patch *patch;
    PatchMatch match;
};

// Robust normal equations of patches about their own best fit together with a prior (information, gradient).
GRASPTRACK_WIDE inline TextureFit fit_patches(const std::vector<PatchRow> &patches, const Matrix<8> &prior, const Vector<8> &prior_gradient,
                              const TextureNumbers &numbers) {
    TextureFit fit;
    const std::size_t n = patches.size();
    fit.weight.assign(n, 0.0);
    for (std::size_t i = 0; i < n; ++i)
        if (patches[i].match.inside) {
            fit.weight[i] = 1.0;
            ++fit.used;
        }
    if (fit.used < 4) return fit;
    std::vector<double> distance(n), sorted;
    double scale = 1.0;
    for (int round = 0; round < 4; ++round) {
        Matrix<8> N{};
        Vector<8> b{};
        for (std::size_t i = 0; i < n; ++i) {
            const double w = fit.weight[i] / (scale * numbers.independent);
            if (!(w > 0)) continue;
            const PatchMatch &m = patches[i].match;
            const auto &J = patches[i].patch->rows;
            const double yx = m.wxx * m.dx + m.wxy * m.dy, yy = m.wxy * m.dx + m.wyy * m.dy;
            for (std::size_t a = 0; a < 8; ++a) {
                const double kx = w * (J[0][a] * m.wxx + J[1][a] * m.wxy), ky = w * (J[0][a] * m.wxy + J[1][a] * m.wyy);
                for (std::size_t c = a & ~std::size_t{1}; c < 8; ++c) N[a * 8 + c] += kx * J[0][c] + ky * J[1][c];
                b[a] += w * (J[0][a] * yx + J[1][a] * yy);
            }
        }
        for (std::size_t a = 0; a < 8; ++a)
            for (std::size_t c = 0; c < a; ++c) N[a * 8 + c] = N[c * 8 + a];
        fit.information = N;
        fit.gradient = b;
        if (round == 3) {
            for (double &w : fit.weight) w /= scale * numbers.independent;
            break;
        }
        Matrix<8> total = N, P;
        Vector<8> g = b;
        for (std::size_t k = 0; k < 64; ++k) total[k] += prior[k];
        for (std::size_t k = 0; k < 8; ++k) g[k] += prior_gradient[k];
        if (!invert<8>(total, P)) return TextureFit{};
        const Vector<8> d = times<8>(P, g);
        sorted.clear();
        for (std::size_t i = 0; i < n; ++i) {
            const PatchMatch &m = patches[i].match;
            if (!m.inside) continue;
            const auto &J = patches[i].patch->rows;
            double ex = m.dx, ey = m.dy;
            for (std::size_t a = 0; a < 8; ++a) {
                ex -= J[0][a] * d[a];
                ey -= J[1][a] * d[a];
            }
            distance[i] = m.wxx * ex * ex + 2 * m.wxy * ex * ey + m.wyy * ey * ey;
            sorted.push_back(distance[i]);
        }
        scale = std::max(1.0, middle(sorted) / 1.386);  // the median of chi-squared with 2 degrees
        double alike = 0;
        for (std::size_t i = 0; i < n; ++i) {
            if (!patches[i].match.inside) continue;
            const double m2 = distance[i] / scale;
            fit.weight[i] = (numbers.freedom + 2) / (numbers.freedom + m2);
            alike += m2 < 9.0 && patches[i].match.correlation > agreeing;
        }
        fit.agreeing = alike / static_cast<double>(n);
        fit.spread = std::sqrt(scale);
    }
    return fit;
}

// The last look laid on the next image.

// Each coarser level has half the places, the first ones, but no fewer than these: its patches are twice as wide.
constexpr std::size_t fewest_places = 24;

// Patches of one look laid on another image, coarse to fine, from a given start. For predictions.
struct FlowFit {
    bool valid = false;
    Homography G{};
    Matrix<8> covariance{};
    double agreeing = 0, correlation = 0;
    int used = 0;
};

inline FlowFit follow_look(const Target &target, const std::vector<PatchSet> &looks, const Pyramid &pyramid, const Homography &start,
                           const Matrix<8> &prior_covariance, double noise, const TextureNumbers &numbers) {
    FlowFit out;
    Matrix<8> prior;
    if (!invert<8>(prior_covariance, prior)) return out;
    Homography G = start;
    for (std::size_t level = looks.size(); level-- > 0;) {
        const PatchSet &set = looks[level];
        if (set.patches.size() < 6) continue;
        for (int round = 0; round < (level + 1 == looks.size() ? 5 : 3); ++round) {
            Vector<8> d;
            if (!target.difference(start, G, d)) return out;
            Matrix<8> A = prior;
            Vector<8> b = times<8>(A, d);
            for (double &value : b) value = -value;
            std::vector<PatchRow> matches;
            double sum = 0;
            for (const Patch &patch : set.patches) {
                matches.push_back({&patch, match_patch(pyramid, G, patch, {patch.x, patch.y}, set.stride, noise, numbers.floor * set.stride)});
                sum += matches.back().match.correlation;
            }
            const TextureFit fit = fit_patches(matches, A, b, numbers);
            if (fit.used < 6) return out;
            for (std::size_t k = 0; k < 64; ++k) A[k] += fit.information[k];
            for (std::size_t k = 0; k < 8; ++k) b[k] += fit.gradient[k];
            Matrix<8> P;
            if (!invert<8>(A, P)) return out;
            const Vector<8> step = times<8>(P, b);
            G = target.moved(G, step);
            for (double value : G)
                if (!std::isfinite(value)) return out;
            out.covariance = P;
            out.used = fit.used;
            out.agreeing = fit.agreeing;
            out.correlation = sum / static_cast<double>(matches.size());
            double most = 0;
            for (double value : step) most = std::max(most, std::abs(value));
            if (most < 0.05 * set.stride) break;
        }
    }
    out.valid = out.used > 0;
    out.G = G;
    return out;
}

}  // namespace grasptrack::pose
