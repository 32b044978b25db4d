#include "cli/help_text.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdint>
#include <set>
#include <string_view>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"

namespace tessera::cli {
namespace {

constexpr std::size_t kMaxChoices = 40;  // characters that fit beside the name of an option

/// A number as people write it: "1000000" instead of "1e+06", "1e9" instead of "1e+09".
std::string plain_number(const std::string& text) {
  double value = 0;
  if (!absl::StrContains(text, 'e') || !absl::SimpleAtod(text, &value)) return text;
  if (value == std::floor(value) && std::abs(value) <= 1e6) {
    return absl::StrCat(static_cast<std::int64_t>(value));
  }
  return absl::StrReplaceAll(text, {{"e+0", "e"}, {"e+", "e"}, {"e-0", "e-"}});
}

/// A default as it is typed; CLI11 writes a list as "[a,b]".
std::string plain_default(const std::string& text) {
  if (text.starts_with('[') && text.ends_with(']')) return text.substr(1, text.size() - 2);
  return plain_number(text);
}

/// Splits CLI11's type name, "NAME:INT in [1 - 9]" or "NAME:{a,b}", into the name and the
/// description of its validator. A name may contain colons.
std::pair<std::string, std::string> split_type(const std::string& type) {
  for (const std::string_view start : {":INT in [", ":UINT in [", ":FLOAT in [", ":{"}) {
    const std::size_t at = type.rfind(start);
    if (at != std::string::npos) return {type.substr(0, at), type.substr(at + 1)};
  }
  const std::size_t at = type.rfind(":NONNEGATIVE");
  if (at != std::string::npos) return {type.substr(0, at), "NONNEGATIVE"};
  return {type, ""};
}

/// The name of a value in place of the name of its type: "N" for "INT", "WxH" for "TEXT:WxH".
std::string plain_name(const std::string& type) {
  if (type == "INT" || type == "UINT" || type == "FLOAT") return "N";
  return type.starts_with("TEXT:") ? type.substr(5) : type;
}

/// The value of an option.
struct Value {
  std::string name;    // or its choices; empty: a flag
  std::string limits;  // range or choices; may be empty
};

Value parse_value(const std::string& type) {
  const auto [name, validator] = split_type(type);
  if (validator.empty()) return {plain_name(name), ""};
  if (validator == "NONNEGATIVE") return {plain_name(name), "0 or more"};
  const bool is_set = validator.front() == '{';
  const std::size_t start = validator.find(is_set ? '{' : '[') + 1;
  const std::string inside = validator.substr(start, validator.size() - start - 1);
  if (!is_set) {
    const std::vector<std::string> ends = absl::StrSplit(inside, " - ");
    return {plain_name(name),
            absl::StrCat(plain_number(ends.front()), " to ", plain_number(ends.back()))};
  }
  if (inside.size() <= kMaxChoices) return {absl::StrReplaceAll(inside, {{",", "|"}}), ""};
  return {plain_name(name), "one of: " + absl::StrReplaceAll(inside, {{",", ", "}})};
}

/// Adds a remark in parentheses, or to those about the default at the end of the text.
std::string with_remark(std::string text, const std::string& remark) {
  const std::size_t last = text.rfind('(');
  const bool ends_with_default =
      last != std::string::npos && text.ends_with(')') && text.compare(last, 8, "(default") == 0;
  if (!ends_with_default) return absl::StrCat(text, " (", remark, ")");
  text.pop_back();
  return absl::StrCat(text, "; ", remark, ")");
}

std::set<std::string> names_of(const std::set<CLI::Option*>& options) {
  std::set<std::string> names;
  for (const CLI::Option* option : options) names.insert(option->get_name());
  return names;
}

Value value_of(const CLI::Option& option) {
  return option.get_items_expected_max() > 0 ? parse_value(option.get_type_name()) : Value();
}

std::string default_of(const CLI::Option& option) {
  return option.get_items_expected_max() > 0 ? plain_default(option.get_default_str()) : "";
}

/// The description with the option's conditions, and with `last` as the last of these if it is not
/// empty. What the description says already is not repeated.
std::string described(const CLI::Option& option, const std::string& last) {
  const std::string& description = option.get_description();
  std::vector<std::string> conditions;
  const auto add = [&](const std::string& condition, const std::string& said_by) {
    if (!absl::StrContains(description, said_by)) conditions.push_back(condition);
  };
  if (const Value value = value_of(option); !value.limits.empty()) {
    conditions.push_back(value.limits);
  }
  if (option.nonpositional()) {
    const bool is_list = option.get_expected_max() == CLI::detail::expected_max_vector_size;
    if (option.get_required()) conditions.emplace_back("required");
    if (is_list && option.get_delimiter() == '\0') add("repeatable", "repeatable");
  }
  for (const std::string& other : names_of(option.get_needs())) add("with " + other, other);
  for (const std::string& other : names_of(option.get_excludes())) {
    conditions.push_back("not with " + other);
  }
  const std::string& variable = option.get_envname();
  if (!variable.empty()) add("environment variable: " + variable, variable);
  if (!last.empty()) conditions.push_back(last);
  return conditions.empty() ? description
                            : with_remark(description, absl::StrJoin(conditions, "; "));
}

class HelpFormatter : public CLI::Formatter {
 public:
  std::string make_option_name(const CLI::Option* option, bool is_positional) const override {
    // CLI11 writes {false} behind the negative name of a flag.
    return absl::StrReplaceAll(CLI::Formatter::make_option_name(option, is_positional),
                               {{"{false}", ""}});
  }

  std::string make_option_opts(const CLI::Option* option) const override {
    if (!option->nonpositional()) return "";
    const std::string value = value_of(*option).name;
    return value.empty() ? "" : " " + value;
  }

  std::string make_option_desc(const CLI::Option* option) const override {
    const std::string text = default_of(*option);
    return described(*option, text.empty() ? "" : "default: " + text);
  }

  std::string make_help(const CLI::App* app, std::string name,
                        CLI::AppFormatMode mode) const override {
    return absl::StrReplaceAll(CLI::Formatter::make_help(app, std::move(name), mode),
                               {{"\n\n\n", "\n\n"}});
  }

  std::string make_expanded(const CLI::App* command) const override {
    std::string text =
        absl::StrCat(command->get_display_name(true), "\n", make_description(command),
                     make_positionals(command), make_groups(command, CLI::AppFormatMode::Sub),
                     make_subcommands(command, CLI::AppFormatMode::All));
    text = absl::StrReplaceAll(text, {{"\n\n", "\n"}});
    while (text.ends_with('\n')) text.pop_back();
    return absl::StrReplaceAll(text, {{"\n", "\n  "}}) + "\n";
  }
};

}  // namespace

OptionText option_text(const CLI::Option& option) {
  return {value_of(option).name, described(option, {}), default_of(option)};
}

std::shared_ptr<CLI::FormatterBase> help_formatter() {
  return std::make_shared<HelpFormatter>();
}

}  // namespace tessera::cli
