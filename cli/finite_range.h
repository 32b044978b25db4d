#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace tessera::cli {

/// Returns a validator for numbers in [min, max]. Unlike CLI::Range it rejects NaN.
inline CLI::Validator finite_range(double min, double max) {
  const CLI::Range range(min, max);
  return {[range](std::string& text) {
            double value = 0;
            const bool is_nan = CLI::detail::lexical_cast(text, value) && value != value;
            return is_nan ? text + " is not a number" : range(text);
          },
          range.get_description()};
}

}  // namespace tessera::cli
