// SPDX-License-Identifier: Apache-2.0
// The focal length and the tilt of the first view's plane, theta, that explain the poses of views that differ.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "camera.hpp"
#include "system.hpp"

namespace grasptrack::pose {

using Theta = Vector<3>;
using Slopes = Vector<2>;

constexpr double horizon = 1e-9;                   // share of the largest depth below which a place lies not before the camera
constexpr double least_sd = 1e-3, narrower = 0.7;  // of theta: looked at no more closely; factor by which one is tried smaller
constexpr std::size_t most_modes = 2;              // explanations that are kept: two views of a plane have two
constexpr double same_slopes = 0.01;               // slopes nearer than this are one explanation: half a degree
constexpr double most_above = 20.0;                // cost above the least, twice a log, beyond which an explanation is dropped: 1 to 22,000
constexpr double two_sd = 4.0;                     // rise of the cost at two standard deviations of a Gaussian
constexpr double negligible = 1e-3;                // probability below which what is open is left out
constexpr double held = 1e12;                      // precision of what shall not move
constexpr double near_slope = 0.4, far_slope = 1.2;  // at which explanations are sought: 22 and 50 degrees from the camera's axis
constexpr std::size_t focals = 7;                  // at which few views are looked at, so many standard deviations of its log apart:
constexpr double focal_step = 0.7, wider = 2.0;    // and a variance is taken so much larger where it says where to look
constexpr int lm_steps = 20;                       // of Levenberg and Marquardt: most steps, and the gain below which they end, ...
constexpr double least_gain = 1e-3, first_damping = 1e-3, less_damping = 0.3, more_damping = 5.0, most_damping = 1e5;  // ... and the damping
constexpr double not_square = 0.01, most_aspect = 0.3;  // probability of pixels that are not square, and the range of their aspect's log then
constexpr double root_two_pi = 2.5066282746310002;
constexpr double square = 0.02, aspect_step = 1e-3;  // the same up to which they count as square, as of lenses that are not quite a pinhole

// What is known of theta before a view has told of it: Gaussian, the slopes of a t distribution where its freedom is finite.
struct Beforehand {
    Theta theta;
    Matrix<3> scale;
    double freedom;
};

// A cost, twice the negative log of a density, with the matrix and right side of its normal equations.
template <std::size_t N> struct Equations {
    double cost = 0.0;
    Matrix<N> A{};
    Vector<N> b{};
};

struct Mode {
    Theta theta;
    Matrix<3> covariance;
    double probability, cost;
};

// Slopes that are open, with the focal length that goes with them, and their probability.
struct OpenTilt {
    Theta theta;
    double weight, cost;
};

class PlaneViews {
  public:
    PlaneViews(const Target &target, const Numbers &numbers, const Frame &frame, std::vector<Point> hull, const Beforehand &before)
        : target_(target), numbers_(numbers), frame_(frame), hull_(std::move(hull)), before_(before) {
        const Matrix<3> &C = before.scale;
        const bool good = invert<2>(block<3, 2>(C, 1), by_slopes_);
        const Slopes with = times<2>(by_slopes_, Slopes{C[3], C[6]});
        const double sd = std::sqrt(C[0] - with[0] * C[3] - with[1] * C[6]);
        if (!good || !(sd > 0.0)) throw std::invalid_argument("the scale is that of no distribution");
        by_focal_ = {1.0 / sd, -with[0] / sd, -with[1] / sd};
    }

    // A view that told: its pose, and the covariance of that.
    void add(const Homography &G, const Matrix<8> &P) {
        View view{{G}, P};
        for (std::size_t i = 0; i < 8; ++i) {
            Vector<8> d{};
            d[i] = pose_step;
            view.poses[i + 1] = target_.moved(G, d);
        }
        views_.push_back(view);
    }

    // A pose can be plainly wrong, as one in an image that is blurred or half covered: its error has heavy tails.
    Equations<3> equations(const Theta &theta) const {
        Equations<3> out = prior(theta);
        if (!is_seen(theta)) {
            out.cost = std::numeric_limits<double>::infinity();
            return out;
        }
        const double freedom = numbers_.prior_freedom;
        const Cameras cameras(*this, theta);
        for (const View &view : views_) {
            const Seen seen = cameras.look(view);
            out.cost += (freedom + 2.0) * std::log1p(seen.far / freedom);
            add_view<3>(out, seen, {seen.by_theta[0], seen.by_theta[1]}, (freedom + 2.0) / (freedom + seen.far));
        }
        if (!std::isfinite(out.cost)) out.cost = std::numeric_limits<double>::infinity();
        return out;
    }

    // Explanations of all views, the most probable first, sought from these starts; none where nothing explains them.
    std::vector<Mode> modes(const std::vector<Theta> &starts) const {
        std::vector<Mode> found;
        for (const Theta &start : starts) {
            const Mode mode = minimum(start, false);
            const auto same = [&mode](const Mode &other) { return apart(mode.theta, other.theta[1], other.theta[2]) <= same_slopes * same_slopes; };
            if (std::isfinite(mode.cost) && std::none_of(found.begin(), found.end(), same)) found.push_back(mode);
        }
        std::stable_sort(found.begin(), found.end(), [](const Mode &a, const Mode &b) { return a.cost < b.cost; });
        found.resize(std::min(found.size(), most_modes));
        while (!found.empty() && !(found.back().cost < found.front().cost + most_above)) found.pop_back();
        double sum = 0.0;
        for (Mode &mode : found) {
            mode.covariance = shrunk(mode);
            const Matrix<3> &C = mode.covariance;
            const double volume = dot({C[0], C[1], C[2]}, cross({C[3], C[4], C[5]}, {C[6], C[7], C[8]}));
            mode.probability = std::exp(-0.5 * (mode.cost - found.front().cost)) * std::sqrt(std::max(volume, 0.0));
            sum += mode.probability;
        }
        for (Mode &mode : found) mode.probability /= sum;
        return found.size() > 1 ? merged(found[0], found[1]) : found;
    }

    // What stands for what few views leave open, the most probable first, where no two Gaussians describe it.
    //
    // For each of some focal lengths the slopes that explain the views best are sought, and what lies about these, at `nodes` of a
    // standard Gaussian, counts as probable as it is: importance sampling, by the Gaussians that were found.
    std::vector<OpenTilt> open_tilts(std::vector<Slopes> starts, const std::vector<Point> &nodes) const {
        struct Bump {
            Slopes middle;
            Matrix<2> inverse, lower;
            double density;
        };
        std::vector<OpenTilt> out;
        for (const Slopes &s : around(near_slope)) starts.push_back(s);
        for (const Slopes &s : around(far_slope)) starts.push_back(s);
        for (std::size_t k = 0; k < focals; ++k) {
            const double log = before_.theta[0] + std::sqrt(before_.scale[0]) * focal_step * (static_cast<double>(k) - 0.5 * (focals - 1));
            std::vector<Bump> bumps;
            for (const Slopes &start : starts) {
                const Mode mode = minimum({log, start[0], start[1]}, true);
                const auto same = [&mode](const Bump &b) { return apart(mode.theta, b.middle[0], b.middle[1]) <= same_slopes * same_slopes; };
                if (!std::isfinite(mode.cost) || std::any_of(bumps.begin(), bumps.end(), same) || !is_seen(mode.theta)) continue;
                Matrix<2> C = block<3, 2>(mode.covariance, 1), lower, rest, inverted;
                for (double &value : C) value *= wider;
                if (!cholesky<2>(C, lower, rest) || !invert<2>(C, inverted)) continue;
                bumps.push_back({{mode.theta[1], mode.theta[2]}, inverted, lower, 1.0 / (lower[0] * lower[3])});
            }
            if (bumps.empty()) continue;
            starts.clear();
            for (const Bump &bump : bumps) starts.push_back(bump.middle);
            for (const Slopes &s : around(far_slope)) starts.push_back(s);
            for (const Bump &bump : bumps)
                for (const Point &node : nodes) {
                    const Matrix<2> &L = bump.lower;
                    const Theta theta{log, bump.middle[0] + L[0] * node.x, bump.middle[1] + L[2] * node.x + L[3] * node.y};
                    const double cost = equations(theta).cost;
                    double density = 0.0;
                    for (const Bump &other : bumps) {
                        const Slopes off{theta[1] - other.middle[0], theta[2] - other.middle[1]};
                        density += std::exp(-0.5 * quadratic<2>(other.inverse, off.data())) * other.density;
                    }
                    if (std::isfinite(cost)) out.push_back({theta, 1.0 / density, cost});
                }
        }
        return most_probable(std::move(out));
    }

    // Width of a pixel for each unit of its height, by one step from theta on both together.
    //
    // Pixels are square, or seldom of any aspect within bounds: the evidence of both decides.
    double pixel_aspect(const Theta &theta) const {
        Equations<4> sum;
        const Equations<3> first = prior(theta);
        for (std::size_t i = 0; i < 3; ++i) {
            sum.b[i] = first.b[i];
            for (std::size_t j = 0; j < 3; ++j) sum.A[i * 4 + j] = first.A[i * 3 + j];
        }
        const double freedom = numbers_.prior_freedom;
        const Cameras cameras(*this, theta);
        const Pinhole wider_pixels(target_, theta, {frame_.width, frame_.height, frame_.aspect * std::exp(aspect_step)});
        for (const View &view : views_) {
            const Seen seen = cameras.look(view);
            const auto there = wider_pixels.misfit(view.poses[0]);
            std::array<Vector<4>, 2> J;
            for (std::size_t k = 0; k < 2; ++k)
                J[k] = {seen.by_theta[k][0], seen.by_theta[k][1], seen.by_theta[k][2], (there[k] - seen.misfit[k]) / aspect_step};
            add_view<4>(sum, seen, J, (freedom + 2.0) / (freedom + seen.far));
        }
        Matrix<4> C;
        if (!invert<4>(sum.A, C)) return frame_.aspect;
        const double sd = std::sqrt(std::max(C[15], 0.0)), log = std::clamp(std::log(frame_.aspect) + times<4>(C, sum.b)[3], -most_aspect, most_aspect);
        const double gain = 0.5 * std::min(log / sd * (log / sd), 2.0 * most_above);
        const double odds = not_square * root_two_pi * sd / (2.0 * most_aspect) * std::exp(gain);
        return odds > 1.0 && std::abs(log) > square ? std::exp(log) : 1.0;
    }

  private:
    struct View {
        std::array<Homography, 9> poses;  // as it is, and after a step of each number of its error
        Matrix<8> P;
    };

    // By how much a view is none of this plane, how that changes with theta, its weight, and the squared distance.
    struct Seen {
        std::array<double, 2> misfit;
        std::array<Theta, 2> by_theta;
        Matrix<2> weight;
        double far;
    };

    // At theta, and after a step of each number of it.
    class Cameras {
      public:
        Cameras(const PlaneViews &views, const Theta &theta) : own_(views.numbers_.pinhole_sd * views.numbers_.pinhole_sd) {
            for (std::size_t i = 0; i < 4; ++i) {
                Theta there = theta;
                if (i > 0) there[i - 1] += camera_step;
                cameras_.emplace_back(views.target_, there, views.frame_);
            }
        }

        Seen look(const View &view) const {
            constexpr double nan = std::numeric_limits<double>::quiet_NaN();
            if (!cameras_[0].valid()) return {{nan, nan}, {}, {nan, nan, nan, nan}, nan};
            Seen out{};
            out.misfit = cameras_[0].misfit(view.poses[0]);
            std::array<Vector<8>, 2> by_pose;
            for (std::size_t i = 0; i < 8; ++i) {
                const auto there = cameras_[0].misfit(view.poses[i + 1]);
                for (std::size_t k = 0; k < 2; ++k) by_pose[k][i] = (there[k] - out.misfit[k]) / pose_step;
            }
            for (std::size_t i = 0; i < 3; ++i) {
                const auto there = cameras_[i + 1].misfit(view.poses[0]);
                for (std::size_t k = 0; k < 2; ++k) out.by_theta[k][i] = (there[k] - out.misfit[k]) / camera_step;
            }
            const Vector<8> first = times<8>(view.P, by_pose[0]), second = times<8>(view.P, by_pose[1]);
            double c = own_, d = 0.0, e = own_;
            for (std::size_t i = 0; i < 8; ++i) {
                c += by_pose[0][i] * first[i];
                d += by_pose[0][i] * second[i];
                e += by_pose[1][i] * second[i];
            }
            const double s = 1.0 / (c * e - d * d);
            out.weight = {e * s, -d * s, -d * s, c * s};
            out.far = quadratic<2>(out.weight, out.misfit.data());
            return out;
        }

      private:
        double own_;
        std::vector<Pinhole> cameras_;
    };

    template <std::size_t N> static void add_view(Equations<N> &sum, const Seen &seen, const std::array<Vector<N>, 2> &J, double share) {
        const Matrix<2> &W = seen.weight;
        for (std::size_t i = 0; i < N; ++i) {
            const double first = share * (J[0][i] * W[0] + J[1][i] * W[2]), second = share * (J[0][i] * W[1] + J[1][i] * W[3]);
            for (std::size_t j = 0; j < N; ++j) sum.A[i * N + j] += first * J[0][j] + second * J[1][j];
            sum.b[i] -= first * seen.misfit[0] + second * seen.misfit[1];
        }
    }

    Equations<3> prior(const Theta &theta) const {
        Equations<3> out;
        const Theta off{before_.theta[0] - theta[0], before_.theta[1] - theta[1], before_.theta[2] - theta[2]};
        const double squared = quadratic<2>(by_slopes_, &off[1]), n = before_.freedom, along = dot(by_focal_, off);
        const double weight = std::isfinite(n) ? (n + 2.0) / (n + squared) : 1.0;
        for (std::size_t i = 0; i < 3; ++i)
            for (std::size_t j = 0; j < 3; ++j)
                out.A[i * 3 + j] = by_focal_[i] * by_focal_[j] + (i && j ? weight * by_slopes_[(i - 1) * 2 + j - 1] : 0.0);
        out.cost = (std::isfinite(n) ? (n + 2.0) * std::log1p(squared / n) : squared) + along * along;
        out.b = times<3>(out.A, off);
        return out;
    }

    // Whether all of the first view's outline lies before the camera.
    bool is_seen(const Theta &theta) const {
        const double f = frame_.width * std::exp(theta[0]);
        double least = std::numeric_limits<double>::infinity(), most = 0.0;
        for (const Point &p : hull_) {
            const double depth = f + (p.x - 0.5 * frame_.width) * theta[1] + (p.y - 0.5 * frame_.height) * theta[2] / frame_.aspect;
            if (!std::isfinite(depth)) return false;
            least = std::min(least, depth);
            most = std::max(most, std::abs(depth));
        }
        return least > horizon * most;
    }

    // The explanation that is reached from a start, by Levenberg and Marquardt; `slopes_alone` leaves the focal length as it is.
    Mode minimum(Theta theta, bool slopes_alone) const {
        const double stiff = slopes_alone ? held : 0.0;
        Equations<3> here = equations(theta);
        double damping = first_damping;
        Mode out{};
        for (int step = 0; step < lm_steps && std::isfinite(here.cost); ++step) {
            Matrix<3> A = here.A;
            for (std::size_t i = 0; i < 3; ++i) A[i * 4] += damping * A[i * 4] + (i ? 0.0 : stiff);
            if (!invert<3>(A, out.covariance)) break;
            const Theta change = times<3>(out.covariance, here.b);
            const Theta ahead{theta[0] + change[0], theta[1] + change[1], theta[2] + change[2]};
            const Equations<3> there = equations(ahead);
            if (there.cost < here.cost) {
                const bool done = here.cost - there.cost < least_gain;
                theta = ahead;
                here = there;
                damping *= less_damping;
                if (done) break;
            } else if ((damping *= more_damping) > most_damping) break;
        }
        here.A[0] += stiff;
        out.theta = theta;
        out.cost = invert<3>(here.A, out.covariance) ? here.cost : std::numeric_limits<double>::infinity();
        return out;
    }

    // A covariance, made smaller along axes on which the cost rises sooner than its second derivative says: about a frontal view
    // the equations do not change with the slopes to first order.
    Matrix<3> shrunk(const Mode &mode) const {
        const auto [values, axes] = eigen<3>(mode.covariance);
        Matrix<3> out{};
        for (std::size_t k = 0; k < 3; ++k) {
            const Theta axis{axes[k], axes[3 + k], axes[6 + k]};
            const auto cost_at = [&](double s) {
                return equations({mode.theta[0] + s * axis[0], mode.theta[1] + s * axis[1], mode.theta[2] + s * axis[2]}).cost;
            };
            double sd = std::sqrt(std::max(values[k], 0.0));
            while (sd > least_sd && std::isfinite(sd) && cost_at(sd) + cost_at(-sd) - 2.0 * mode.cost > two_sd) sd *= narrower;
            for (std::size_t i = 0; i < 3; ++i)
                for (std::size_t j = 0; j < 3; ++j) out[i * 3 + j] += axis[i] * sd * sd * axis[j];
        }
        return out;
    }

    // Two explanations as one where what lies between them explains the views nearly as well.
    std::vector<Mode> merged(const Mode &one, const Mode &other) const {
        Mode both{{}, {}, 1.0, one.cost};
        for (std::size_t i = 0; i < 3; ++i) both.theta[i] = one.probability * one.theta[i] + other.probability * other.theta[i];
        if (equations(both.theta).cost > one.cost + two_sd)
            return one.probability < other.probability ? std::vector<Mode>{other, one} : std::vector<Mode>{one, other};
        for (const Mode &mode : {one, other})
            for (std::size_t i = 0; i < 3; ++i)
                for (std::size_t j = 0; j < 3; ++j)
                    both.covariance[i * 3 + j] += mode.probability * (mode.covariance[i * 3 + j] + (mode.theta[i] - both.theta[i]) * (mode.theta[j] - both.theta[j]));
        return {both};
    }

    static std::vector<OpenTilt> most_probable(std::vector<OpenTilt> found) {
        double least = std::numeric_limits<double>::infinity(), sum = 0.0, kept = 0.0;
        for (const OpenTilt &each : found) least = std::min(least, each.cost);
        for (OpenTilt &each : found) sum += each.weight *= std::exp(-0.5 * (each.cost - least));
        std::vector<OpenTilt> out;
        for (const OpenTilt &each : found)
            if (each.weight / sum > negligible) out.push_back(each), kept += each.weight;
        std::stable_sort(out.begin(), out.end(), [](const OpenTilt &a, const OpenTilt &b) { return a.weight > b.weight; });
        for (OpenTilt &each : out) each.weight /= kept;
        return out;
    }

    static std::array<Slopes, 4> around(double reach) { return {{{reach, 0.0}, {-reach, 0.0}, {0.0, reach}, {0.0, -reach}}}; }

    static double apart(const Theta &theta, double s1, double s2) { return (theta[1] - s1) * (theta[1] - s1) + (theta[2] - s2) * (theta[2] - s2); }

    Target target_;
    Numbers numbers_;
    Frame frame_;
    std::vector<Point> hull_;
    Beforehand before_;
    Matrix<2> by_slopes_;  // inverse scale of the slopes
    Theta by_focal_;       // of the focal length beyond what goes with them, in standard deviations
    std::vector<View> views_;
};

}  // namespace grasptrack::pose
