#include "cli/config_file.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <numeric>
#include <set>
#include <string>
#include <string_view>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace tessera::cli {
namespace {

/// CLI11's items for the beginning and the end of a table.
bool is_mark(const CLI::ConfigItem& item) {
  return item.name == "++" || item.name == "--";
}

/// Levenshtein's distance: how many characters to insert, delete or replace.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({row[j] + 1, row[j + 1] + 1, replaced});
    }
  }
  return row.back();
}

/// The name most like `name`; empty if more than half of it differs.
std::string nearest_name(const std::string& name, const std::vector<std::string>& known) {
  std::string nearest;
  std::size_t least = name.size() / 2 + 1;
  for (const std::string& each : known) {
    const std::size_t distance = edit_distance(name, each);
    if (distance >= least) continue;
    least = distance;
    nearest = each;
  }
  return nearest;
}

std::vector<std::string> option_names(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::Option* option : command.get_options()) {
    if (!option->get_configurable()) continue;
    for (const std::string& name : option->get_lnames()) names.push_back(name);
  }
  return names;
}

std::vector<std::string> command_names(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::App* each : command.get_subcommands({})) names.push_back(each->get_name());
  return names;
}

std::string suggestion(const std::string& before, const std::string& nearest,
                       const std::string& after) {
  return nearest.empty() ? "" : absl::StrCat("; did you mean ", before, nearest, after, "?");
}

}  // namespace

/// The command that an item's table belongs to; null if there is none.
const CLI::App* ConfigFile::command_of(const CLI::ConfigItem& item) const {
  const CLI::App* command = &app_;
  for (const std::string& name : item.parents) {
    const auto found =
        command->get_subcommands([&](const CLI::App* each) { return each->check_name(name); });
    if (found.empty()) return nullptr;
    command = found.front();
  }
  return command;
}

/// The option of an item; null for marks.
const CLI::Option* ConfigFile::option_of(const CLI::ConfigItem& item) const {
  return is_mark(item) ? nullptr : command_of(item)->get_option_no_throw("--" + item.name);
}

/// Throws if the item names no option or command.
void ConfigFile::refuse_unknown(const CLI::ConfigItem& item) const {
  const auto file = app_.get_config_ptr()->as<std::string>();
  const std::string table = absl::StrCat("[", absl::StrJoin(item.parents, "."), "]");
  const CLI::App* command = command_of(item);
  if (command == nullptr) {
    throw CLI::ConfigError(absl::StrCat(
        file, ": unknown table ", table,
        suggestion("[", nearest_name(item.parents.front(), command_names(app_)), "]")));
  }
  if (is_mark(item) || option_of(item) != nullptr) return;
  throw CLI::ConfigError(absl::StrCat(
      file, ": unknown key ", item.name, item.parents.empty() ? "" : absl::StrCat(" in ", table),
      suggestion("", nearest_name(item.name, option_names(*command)), "")));
}

std::vector<CLI::ConfigItem> ConfigFile::from_config(std::istream& input) const {
  std::vector<CLI::ConfigItem> given = CLI::ConfigTOML::from_config(input);
  for (const CLI::ConfigItem& item : given) refuse_unknown(item);
  const auto is_typed = [](const CLI::Option* option) { return option->count() > 0; };
  const auto drop_if = [&](const auto& condition) {
    const auto is_dropped = [&](const CLI::ConfigItem& item) {
      const CLI::Option* option = option_of(item);
      return option != nullptr && condition(*option);
    };
    given.erase(std::remove_if(given.begin(), given.end(), is_dropped), given.end());
  };
  drop_if([](const CLI::Option& option) {  // the environment takes precedence over the file
    return !option.get_envname().empty() && std::getenv(option.get_envname().c_str()) != nullptr;
  });
  drop_if([&](const CLI::Option& option) {
    const auto others = option.get_excludes();
    return std::any_of(others.begin(), others.end(), is_typed);
  });
  std::set<const CLI::Option*> defaults;
  for (const CLI::ConfigItem& item : given) defaults.insert(option_of(item));
  drop_if([&](const CLI::Option& option) {
    const auto needed = option.get_needs();
    return std::any_of(needed.begin(), needed.end(), [&](const CLI::Option* each) {
      return !is_typed(each) && defaults.count(each) == 0;
    });
  });
  return given;
}

}  // namespace tessera::cli
