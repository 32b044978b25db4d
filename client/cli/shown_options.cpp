#include "client/cli/shown_options.h"

#include <CLI/CLI.hpp>
#include <utility>

#include "cli/help_text.h"

namespace tessera::client {
namespace {

/// An option group is a subcommand without a name.
bool is_option_group(const CLI::App& app) {
  return app.get_name().empty() && app.get_parent() != nullptr;
}

}  // namespace

std::vector<ShownOption> shown_options(const CLI::App& app) {
  std::vector<ShownOption> shown;
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty() || option->get_positional()) continue;
    if (is_option_group(app) && option == app.get_help_ptr()) continue;  // shown by its command
    ShownOption one;
    for (const std::string& name : option->get_snames()) one.names.push_back("-" + name);
    for (const std::string& name : option->get_lnames()) one.names.push_back("--" + name);
    cli::OptionText text = cli::option_text(*option);
    one.value = std::move(text.value);
    one.description = std::move(text.description);
    one.default_value = std::move(text.default_value);
    if (!one.names.empty()) shown.push_back(std::move(one));
  }
  for (const CLI::App* group :
       app.get_subcommands([](const CLI::App* each) { return is_option_group(*each); })) {
    for (ShownOption& option : shown_options(*group)) shown.push_back(std::move(option));
  }
  return shown;
}

std::vector<const CLI::App*> shown_subcommands(const CLI::App& app) {
  return app.get_subcommands(
      [](const CLI::App* each) { return !each->get_group().empty() && !is_option_group(*each); });
}

}  // namespace tessera::client
