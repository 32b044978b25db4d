#include "worker/gltf/validate/values/value_checks.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <string>

#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/schema/matrix_rules.h"
#include "worker/gltf/validate/values/accessor_values.h"

namespace tessera::render {

namespace {

using Kind = ValueCheck::Kind;
constexpr double kVectorTolerance = 0.00674;  // that of the Khronos glTF validator

std::string at_element(std::int64_t element, double value) {
  char text[64];
  std::snprintf(text, sizeof text, "element %lld is %.9g", static_cast<long long>(element), value);
  return text;
}

/// The first breach of each rule at a pointer.
class Breaches {
 public:
  void add(const ValidationRule& rule, std::int64_t element, double value) {
    for (std::size_t i = 0; i < count_; ++i) {
      if (found_[i].rule == &rule) return;
    }
    found_[count_++] = {&rule, element, value};
  }
  void report(ValidationFindings& findings, const std::string& pointer) const {
    for (std::size_t i = 0; i < count_; ++i) {
      findings.add(*found_[i].rule, pointer, at_element(found_[i].element, found_[i].value));
    }
  }

 private:
  struct Breach {
    const ValidationRule* rule;
    std::int64_t element;
    double value;
  };
  std::array<Breach, 4> found_ = {};
  std::size_t count_ = 0;
};

double length(const double* values, int count) {
  double sum = 0;
  for (int i = 0; i < count; ++i) sum += values[i] * values[i];
  return std::sqrt(sum);
}

/// Evaluates the rules of one ValueCheck over all elements of its accessor.
class ValueRules {
 public:
  ValueRules(const ValueCheck& check, const AccessorValues& values, const AccessorFormat& format)
      : check_(check), values_(values), index_limit_(restart_value(format.component)) {}

  void element(std::int64_t i, const double* v) {
    switch (check_.kind) {
      case Kind::unit_vectors:
        return unit(i, v, 3, kVectorTolerance, rules::kAccessorVector3NonUnit);
      case Kind::tangents:
        unit(i, v, 3, kVectorTolerance, rules::kAccessorVector3NonUnit);
        if (std::abs(decoded(v[3])) != 1) breaches_.add(rules::kAccessorInvalidSign, i, v[3]);
        return;
      case Kind::colours:
        for (int k = 0; k < values_.components(); ++k) {
          if (v[k] < 0 || v[k] > 1) breaches_.add(rules::kAccessorNonClamped, i, v[k]);
        }
        return;
      case Kind::indices:
        return index(i, v[0]);
      case Kind::times:
        return time(i, v[0]);
      case Kind::quaternions:
        // A cubic spline has a tangent before each value and one after it.
        if (check_.cubic && i % 3 != 1) return;
        return unit(i, v, 4, kQuaternionTolerance,
                    rules::kAccessorAnimationSamplerOutputNonNormalizedQuaternion);
      case Kind::inverse_binds:
        for (const int k : {3, 7, 11, 15}) {
          if (v[k] != (k == 15 ? 1 : 0)) breaches_.add(rules::kAccessorInvalidIbm, i, v[k]);
        }
        return;
    }
  }

  void report(ValidationFindings& findings) const {
    breaches_.report(findings, check_.pointer);
    if (degenerate_ > 0) {
      findings.add(rules::kAccessorIndexTriangleDegenerate, check_.pointer,
                   std::to_string(degenerate_) + " of " + std::to_string(values_.count() / 3));
    }
  }

 private:
  static double restart_value(std::int64_t component) {
    return component == 5121 ? 255 : component == 5123 ? 65535 : 4294967295.0;
  }

  [[nodiscard]] double decoded(double value) const { return values_.normalized(value); }

  void unit(std::int64_t i, const double* v, int count, double tolerance,
            const ValidationRule& rule) {
    double vector[4] = {};
    for (int k = 0; k < count; ++k) vector[k] = decoded(v[k]);
    const double size = length(vector, count);
    if (std::abs(size - 1) > tolerance) breaches_.add(rule, i, size);
  }

  void index(std::int64_t i, double value) {
    const auto limit = static_cast<double>(check_.vertices == kNoIndex ? 0 : check_.vertices);
    if (value >= limit) breaches_.add(rules::kAccessorIndexOob, i, value);
    if (value == index_limit_) breaches_.add(rules::kAccessorIndexPrimitiveRestart, i, value);
    if (!check_.triangles) return;
    const auto corner = static_cast<std::size_t>(i % 3);
    triangle_[corner] = value;
    const auto& [a, b, c] = triangle_;
    if (corner == 2 && (a == b || b == c || c == a)) ++degenerate_;
  }

  void time(std::int64_t i, double value) {
    if (value < 0) {
      breaches_.add(rules::kAccessorAnimationInputNegative, i, value);
      return;
    }
    if (i > 0 && value <= previous_) {
      breaches_.add(rules::kAccessorAnimationInputNonIncreasing, i, value);
    }
    previous_ = value;
  }

  const ValueCheck& check_;
  const AccessorValues& values_;
  double index_limit_;
  Breaches breaches_;
  std::array<double, 3> triangle_ = {};
  std::int64_t degenerate_ = 0;
  double previous_ = 0;
};

/// Checks finite values and declared bounds of an accessor.
class BoundsRules {
 public:
  BoundsRules(const JsonNode& json, const AccessorValues& values) : values_(values) {
    const auto components = static_cast<std::size_t>(values.components());
    for (const bool is_max : {false, true}) {
      Bound& bound = bounds_[is_max ? 1 : 0];
      const JsonNode& declared = json[is_max ? "max" : "min"];
      if (!declared.is(JsonNode::Kind::array) || declared.size() != components) continue;
      for (const JsonNode& each : declared.items()) {
        const double value = each.number();
        bound.declared.push_back(values.is_float() ? static_cast<float>(value) : value);
      }
      bound.actual.resize(components);
      bound.beyond.resize(components);
    }
  }

  void element(std::int64_t i, const double* v) {
    for (std::size_t k = 0; k < static_cast<std::size_t>(values_.components()); ++k) {
      if (!std::isfinite(v[k])) not_finite_.add(rules::kAccessorInvalidFloat, i, v[k]);
      for (const bool is_max : {false, true}) {
        Bound& bound = bounds_[is_max ? 1 : 0];
        if (bound.declared.empty()) continue;
        const auto beyond = [&](double limit) { return is_max ? v[k] > limit : v[k] < limit; };
        if (i == 0 || beyond(bound.actual[k])) bound.actual[k] = v[k];
        if (beyond(bound.declared[k])) ++bound.beyond[k];
      }
    }
  }

  void report(ValidationFindings& findings, const std::string& path) const {
    not_finite_.report(findings, path);
    for (const bool is_max : {false, true}) {
      const Bound& bound = bounds_[is_max ? 1 : 0];
      const std::string inner = pointer_to(path, is_max ? "max" : "min");
      for (std::size_t k = 0; k < bound.declared.size(); ++k) {
        if (bound.declared[k] == bound.actual[k]) continue;
        findings.add_at(is_max ? rules::kAccessorMaxMismatch : rules::kAccessorMinMismatch, inner,
                        k, number_text(bound.actual[k]));
        if (bound.beyond[k] == 0) continue;
        findings.add_at(
            is_max ? rules::kAccessorElementOutOfMaxBound : rules::kAccessorElementOutOfMinBound,
            inner, k, std::to_string(bound.beyond[k]));
      }
    }
  }

 private:
  struct Bound {
    std::vector<double> declared, actual;  // empty: not declared
    std::vector<std::int64_t> beyond;
  };

  static std::string number_text(double value) {
    char text[64];
    std::snprintf(text, sizeof text, "it is %.9g", value);
    return text;
  }

  const AccessorValues& values_;
  std::array<Bound, 2> bounds_;
  Breaches not_finite_;
};

void check_sparse_indices(LinkedDocument& document, std::size_t i) {
  const LinkedAccessor& accessor = document.linked_accessors[i];
  const auto indices = find_sparse_indices(document, static_cast<std::int64_t>(i));
  if (!accessor.is_complete() || !indices) return;
  Breaches breaches;
  for (std::int64_t k = 0; k < indices->count; ++k) {
    const std::uint32_t index = (*indices)[k];
    if (k > 0 && index <= (*indices)[k - 1]) {
      breaches.add(rules::kAccessorSparseIndicesNonIncreasing, k, index);
    }
    if (index >= accessor.count) breaches.add(rules::kAccessorSparseIndexOob, k, index);
  }
  breaches.report(document.findings, pointer_to(document.accessors.pointer(i), "sparse"));
}

/// Reads an accessor once for all its checks.
void check_accessor(LinkedDocument& document, std::size_t i,
                    const std::vector<const ValueCheck*>& checks, ValueBudget& budget) {
  auto values = AccessorValues::open(document, static_cast<std::int64_t>(i));
  if (!values) return;
  const LinkedAccessor& accessor = document.linked_accessors[i];
  const JsonNode& json = *document.accessors.get(static_cast<std::int64_t>(i));
  const auto cost = static_cast<std::uint64_t>(values->count()) *
                    static_cast<std::uint64_t>(values->components()) * (1 + checks.size());
  if (!budget.take(cost)) return;
  BoundsRules bounds(json, *values);
  std::vector<ValueRules> rules;
  rules.reserve(checks.size());
  for (const ValueCheck* check : checks) rules.emplace_back(*check, *values, accessor.format);
  double v[16];
  for (std::int64_t k = 0; k < values->count(); ++k) {
    values->next(v);
    bounds.element(k, v);
    for (ValueRules& rule : rules) rule.element(k, v);
  }
  bounds.report(document.findings, document.accessors.pointer(i));
  for (const ValueRules& rule : rules) rule.report(document.findings);
}

}  // namespace

bool ValueBudget::take(std::uint64_t values) {
  if (values > left_) {
    exhausted_ = true;
    return false;
  }
  left_ -= values;
  return true;
}

void check_accessor_values(LinkedDocument& document, ValueBudget& budget) {
  std::vector<std::vector<const ValueCheck*>> checks(document.accessors.size());
  for (const ValueCheck& check : document.value_checks) {
    checks[static_cast<std::size_t>(check.accessor)].push_back(&check);
  }
  for (std::size_t i = 0; i < document.accessors.size(); ++i) {
    if (document.linked_accessors[i].has_sparse) check_sparse_indices(document, i);
    check_accessor(document, i, checks[i], budget);
  }
}

}  // namespace tessera::render
