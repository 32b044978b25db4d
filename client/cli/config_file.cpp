#include "client/cli/config_file.h"

#include <algorithm>
#include <cstdlib>
#include <set>
#include <string>

namespace tessera::client {

/// Returns the option of a configuration item; null if there is none, which CLI11 reports.
const CLI::Option* ConfigFile::option_of(const CLI::ConfigItem& item) const {
  const CLI::App* command = &app_;
  for (const std::string& name : item.parents) {
    const auto found =
        command->get_subcommands([&](const CLI::App* each) { return each->check_name(name); });
    if (found.empty()) return nullptr;
    command = found.front();
  }
  return command->get_option_no_throw("--" + item.name);
}

std::vector<CLI::ConfigItem> ConfigFile::from_config(std::istream& input) const {
  std::vector<CLI::ConfigItem> given = CLI::ConfigTOML::from_config(input);
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

}  // namespace tessera::client
