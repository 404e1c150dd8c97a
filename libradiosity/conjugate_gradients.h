#pragma once
/// The radiosity system by conjugate gradients, whatever carries light between patches; for solve_links.cpp and solve_stored.cpp.
/// `Transport::apply(surfaces, b, power, run)`: the power [lm] that patches receive from exitances b, symmetric.
#include <algorithm>
#include <cmath>
#include <type_traits>

#include "libradiosity/cluster_tree.h"
#include "libradiosity/shoot.h"

namespace lmc {

inline constexpr std::size_t kParts = 64;     // the level is converged in each of about so many parts
inline constexpr double kDimmestPart = 1e-4;  // of the brightest one: darker ones are not waited for
inline constexpr int kScalings = 200;

/// One number a channel, or one for all.
template <class V>
double largest(const V& v) {
  if constexpr (std::is_same_v<V, double>)
    return v;
  else
    return std::max({v.x, v.y, v.z});
}

/// Patches by their place in the tree's order.
struct Surfaces {
  std::vector<double> area, closure;  ///< [m^2], share of what leaves that meets fronts
  std::vector<double> backs;          ///< share that meets backs
  std::vector<double> scale;          ///< d_i of the symmetric scaling
};

/// d_i sum_j T_ij d_j = A_i closure_i: rows become right and reciprocity stays.
template <class Transport>
double closeRows(Surfaces& s, const Transport& transport, double tolerance, const Run& run) {
  const std::size_t n = s.area.size();
  s.scale.assign(n, 1.0);
  std::vector<double> one(n, 1.0), row;
  transport.apply(s, one, row, run);
  double before = 0.0, area = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    before += std::abs(row[i] - s.area[i] * s.closure[i]);
    area += s.area[i];
  }
  double last = 2.0 * area;
  for (int step = 0; step < kScalings; ++step) {
    double off = 0.0;
    for (std::size_t i = 0; i < n; ++i) {
      const double wanted = s.area[i] * s.closure[i];
      if (!(row[i] > 0.0) || !(wanted > 0.0)) continue;
      const double ratio = wanted / row[i];
      off += s.area[i] * std::abs(ratio - 1.0);
      s.scale[i] *= std::sqrt(std::clamp(ratio, 0.25, 4.0));
    }
    // In the open some rows cannot be met (two patches that see each other alone, with different shares): no use in going on.
    if (off <= tolerance * area || (step > 20 && off > 0.97 * last)) break;
    last = off;
    transport.apply(s, one, row, run);
  }
  return before / std::max(area, 1e-300);
}

template <class V>
struct System {
  std::vector<V> rho, direct;  // reflectance, illuminance before any bounce
};

template <class V>
struct Answer {
  std::vector<V> exitance, illuminance;  // by bounces
  std::vector<V> residual;               // power that one more bounce would still change [lm]
  double tail = 0.0, tailEstimate = 0.0;
  int iterations = 0;
  bool converged = false;
};

/// B = rho (E + H), H_i A_i = sum_j T_ij B_j as (I - S) x = b, S = R^1/2 D R^1/2 (solve.h). Stops when each part of the level is converged:
/// a residual r in a room of reflectance rho makes an error of at most r/(1 - rho) there.
template <class V, class Transport>
Answer<V> conjugateGradients(const ClusterTree& tree, const Surfaces& s, const Transport& transport, const System<V>& system,
                             const std::vector<V>& guess, double tolerance, int maxIterations, const Run& run) {
  const std::size_t n = s.area.size();
  const auto each = [](auto f, const V& a, const V& b) {
    if constexpr (std::is_same_v<V, double>)
      return f(a, b);
    else
      return V(f(a.x, b.x), f(a.y, b.y), f(a.z, b.z));
  };
  const auto root = [](const V& v) {
    if constexpr (std::is_same_v<V, double>)
      return std::sqrt(v);
    else
      return glm::sqrt(v);
  };
  const auto quotient = [&](const V& a, const V& b) { return each([](double x, double y) { return y > 0.0 ? x / y : 0.0; }, a, b); };
  std::vector<V> scaled(n), x(n), r(n), p(n), Ap(n), power, B(n);  // scaled_i = sqrt(rho_i/A_i)
  for (std::size_t i = 0; i < n; ++i) scaled[i] = s.area[i] > 0.0 ? root(system.rho[i] / s.area[i]) : V(0.0);
  const auto apply = [&](const std::vector<V>& v, std::vector<V>& out) {
    for (std::size_t i = 0; i < n; ++i) B[i] = scaled[i] * v[i];
    transport.apply(s, B, power, run);
    for (std::size_t i = 0; i < n; ++i) out[i] = v[i] - scaled[i] * power[i];
  };
  double rhoMost = 0.0, rhoMean = 0.0, area = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    rhoMost = std::max(rhoMost, s.area[i] > 0.0 ? largest(system.rho[i]) : 0.0);
    rhoMean += s.area[i] * largest(system.rho[i]);
    area += s.area[i];
    // x = B sqrt(A/rho)
    x[i] = quotient(guess.empty() ? system.rho[i] * system.direct[i] : guess[i], scaled[i]);
  }
  rhoMean /= std::max(area, 1e-300);
  apply(x, Ap);
  V rr(0.0);
  for (std::size_t i = 0; i < n; ++i) {
    r[i] = system.direct[i] * s.area[i] * scaled[i] - Ap[i];
    p[i] = r[i];
    rr += r[i] * r[i];
  }
  const std::vector<std::uint32_t> rooms = parts(tree, std::max<std::size_t>(1, n / kParts));
  Answer<V> out;
  const auto finished = [&] {
    std::vector<double> light(rooms.size()), wrong(rooms.size());
    double brightest = 0.0, left = 0.0, all = 0.0;
    for (std::size_t k = 0; k < rooms.size(); ++k) {
      const Cluster& c = tree.nodes[rooms[k]];
      double absorbed = 0.0;
      for (std::uint32_t i = c.first; i < c.first + c.count; ++i) {
        const V there = x[i] * scaled[i] * s.area[i], rest = r[i] * scaled[i] * s.area[i];
        light[k] += largest(there);
        wrong[k] += largest(each([](double a, double) { return std::abs(a); }, rest, rest));
        absorbed += s.area[i] * (1.0 - largest(system.rho[i]));
      }
      left += wrong[k];
      all += light[k];
      wrong[k] /= std::max(absorbed, 1e-6 * c.area_m2);
      light[k] /= std::max(c.area_m2, 1e-300);
      brightest = std::max(brightest, light[k]);
    }
    out.tail = all > 0.0 ? left / std::max(1e-6, 1.0 - rhoMost) / all : 0.0;
    out.tailEstimate = std::min(out.tail, all > 0.0 ? left / std::max(1e-6, 1.0 - rhoMean) / all : 0.0);
    if (out.tail > tolerance) return false;
    for (std::size_t k = 0; k < rooms.size(); ++k)
      if (light[k] > kDimmestPart * brightest && wrong[k] > tolerance * light[k]) return false;
    return true;
  };
  for (;; ++out.iterations) {
    out.converged = finished();
    if (out.converged || out.iterations >= maxIterations || !(largest(rr) > 0.0)) break;
    apply(p, Ap);
    V pAp(0.0);
    for (std::size_t i = 0; i < n; ++i) pAp += p[i] * Ap[i];
    const V alpha = quotient(rr, pAp);
    V next(0.0);
    for (std::size_t i = 0; i < n; ++i) {
      x[i] += alpha * p[i];
      r[i] -= alpha * Ap[i];
      next += r[i] * r[i];
    }
    const V beta = quotient(next, rr);
    for (std::size_t i = 0; i < n; ++i) p[i] = r[i] + beta * p[i];
    rr = next;
  }
  out.exitance.resize(n);
  out.residual.resize(n);
  for (std::size_t i = 0; i < n; ++i) out.exitance[i] = x[i] * scaled[i];
  transport.apply(s, out.exitance, power, run);
  out.illuminance.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    // Light is not negative; what CG overshoots is within its tolerance.
    out.illuminance[i] = s.area[i] > 0.0 ? each([](double a, double b) { return std::max(a, b); }, power[i] / s.area[i], V(0.0)) : V(0.0);
    out.residual[i] = s.area[i] * (system.rho[i] * (system.direct[i] + out.illuminance[i]) - out.exitance[i]);
  }
  return out;
}

/// One channel is enough.
inline bool grey(const PatchMesh& mesh, const PatchLight& light) {
  const auto is = [](const Rgb& c) { return c.r == c.g && c.g == c.b; };
  for (std::size_t i = 0; i < mesh.patches.size(); ++i)
    if (!is(mesh.patches[i].reflectance) || !is(light.direct[i]) || !is(light.sky[i])) return false;
  return true;
}

/// What the answer says of energy; closure and backs are shares of what leaves a patch.
template <class V>
Energy energyOf(const Surfaces& s, const System<V>& system, const Answer<V>& answer) {
  Energy e;
  for (std::size_t k = 0; k < s.area.size(); ++k) {
    const double A = s.area[k];
    const glm::dvec3 one(1.0), rho = one * system.rho[k], B = one * answer.exitance[k];
    e.sent += A * rho * system.direct[k];
    e.absorbed += A * (one - rho) * answer.illuminance[k];
    e.backs += A * s.backs[k] * B;
    e.left += A * (1.0 - s.closure[k] - s.backs[k]) * B;
    e.unsent -= one * answer.residual[k];
  }
  return e;
}

/// Patches in the tree's order.
template <class V>
System<V> systemOf(const ClusterTree& tree, const PatchMesh& mesh, const PatchLight& light, Surfaces& s) {
  System<V> out;
  for (const std::uint32_t i : tree.order) {
    const glm::dvec3 rho(mesh.patches[i].reflectance), E = glm::dvec3(light.direct[i]) + glm::dvec3(light.sky[i]);
    s.area.push_back(mesh.patches[i].area_m2);
    if constexpr (std::is_same_v<V, double>) {
      out.rho.push_back(rho.x);
      out.direct.push_back(E.x);
    } else {
      out.rho.push_back(rho);
      out.direct.push_back(E);
    }
  }
  s.closure.assign(s.area.size(), 1.0);
  s.backs.assign(s.area.size(), 0.0);
  s.scale.assign(s.area.size(), 1.0);
  return out;
}

template <class V>
Bounced bouncedOf(const ClusterTree& tree, const Answer<V>& answer) {
  Bounced out(tree.order.size(), Rgb(0.0f));
  for (std::size_t k = 0; k < answer.illuminance.size(); ++k) out[tree.order[k]] = Rgb(glm::dvec3(1.0) * answer.illuminance[k]);
  return out;
}

}  // namespace lmc
