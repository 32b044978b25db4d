#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace tessera::cli {

/// Returns a validator for numbers in [least, most]. Unlike CLI::Range it rejects NaN.
inline CLI::Validator finite_range(double least, double most) {
  const CLI::Range range(least, most);
  return {[range](std::string& text) {
            double value = 0;
            const bool is_nan = CLI::detail::lexical_cast(text, value) && value != value;
            return is_nan ? text + " is not a number" : range(text);
          },
          range.get_description()};
}

}  // namespace tessera::cli
