#include "client/commands/completion.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "cli/command.h"
#include "client/cli/shown_options.h"

namespace tessera::client {
namespace {

std::string all_names(const CLI::App& app) {
  std::vector<std::string> words;
  for (const ShownOption& option : shown_options(app)) {
    words.insert(words.end(), option.names.begin(), option.names.end());
  }
  return absl::StrJoin(words, " ");
}

std::string command_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : shown_subcommands(app)) names.push_back(command->get_name());
  return absl::StrJoin(names, " ");
}

std::string bash_script(const CLI::App& app) {
  std::string script =
      "# bash completion of tessera: source it, or put it into "
      "~/.local/share/bash-completion/completions/tessera\n"
      "_tessera() {\n"
      "  local word=\"${COMP_WORDS[COMP_CWORD]}\" command= i\n"
      "  for ((i = 1; i < COMP_CWORD; i++)); do\n"
      "    if [[ ${COMP_WORDS[i]} != -* ]]; then command=\"${COMP_WORDS[i]}\"; break; fi\n"
      "  done\n"
      "  COMPREPLY=()\n"
      "  case \"$command\" in\n";
  absl::StrAppend(&script, "    \"\") COMPREPLY=($(compgen -W \"", command_names(app), " ",
                  all_names(app), "\" -- \"$word\")) ;;\n");
  for (const CLI::App* command : shown_subcommands(app)) {
    absl::StrAppend(&script, "    ", command->get_name(), ") [[ $word == -* ]] && ",
                    "COMPREPLY=($(compgen -W \"", all_names(*command), "\" -- \"$word\")) ;;\n");
  }
  absl::StrAppend(&script,
                  "  esac\n"
                  "}\n"
                  "complete -o default -F _tessera tessera\n");
  return script;
}

/// Text inside zsh's '[…]' within single quotes.
std::string zsh_text(const std::string& text) {
  return absl::StrReplaceAll(
      text, {{"'", "'\\''"}, {"[", "\\["}, {"]", "\\]"}, {":", "\\:"}, {"\n", " "}});
}

std::string zsh_options(const CLI::App& app, const std::string& indent) {
  std::string text;
  for (const ShownOption& option : shown_options(app)) {
    for (const std::string& name : option.names) {
      const char* value = option.value.empty()    ? ""
                          : option.value == "DIR" ? ":folder:_files -/"
                                                  : ":value:_files";
      absl::StrAppend(&text, " \\\n", indent, "'", name, "[", zsh_text(option.description), "]",
                      value, "'");
    }
  }
  return text;
}

std::string zsh_script(const CLI::App& app) {
  std::string script =
      "#compdef tessera\n"
      "# zsh completion of tessera: put it as _tessera into a directory of $fpath\n"
      "_tessera() {\n"
      "  local -a commands\n"
      "  commands=(\n";
  for (const CLI::App* command : shown_subcommands(app)) {
    absl::StrAppend(&script, "    '", command->get_name(), ":",
                    zsh_text(command->get_description()), "'\n");
  }
  absl::StrAppend(&script, "  )\n  _arguments -C", zsh_options(app, "    "),
                  " \\\n    '1:command:->command' '*::argument:->argument'\n"
                  "  case \"$state\" in\n"
                  "    command) _describe command commands ;;\n"
                  "    argument)\n"
                  "      case \"$words[1]\" in\n");
  for (const CLI::App* command : shown_subcommands(app)) {
    absl::StrAppend(&script, "        ", command->get_name(), ") _arguments",
                    zsh_options(*command, "          "), " \\\n          '*:file:_files' ;;\n");
  }
  absl::StrAppend(&script,
                  "      esac ;;\n"
                  "  esac\n"
                  "}\n"
                  "_tessera \"$@\"\n");
  return script;
}

std::string fish_text(const std::string& text) {
  return absl::StrReplaceAll(text, {{"\\", "\\\\"}, {"'", "\\'"}, {"\n", " "}});
}

std::string fish_options(const CLI::App& app, const std::string& condition) {
  std::string text;
  for (const ShownOption& option : shown_options(app)) {
    absl::StrAppend(&text, "complete -c tessera -n '", condition, "'");
    for (const std::string& name : option.names) {
      absl::StrAppend(&text, name[1] == '-' ? " -l " + name.substr(2) : " -s " + name.substr(1));
    }
    absl::StrAppend(&text, !option.value.empty() ? " -r" : "", " -d '",
                    fish_text(option.description), "'\n");
  }
  return text;
}

std::string fish_script(const CLI::App& app) {
  std::string script =
      "# fish completion of tessera: put it into ~/.config/fish/completions/tessera.fish\n";
  for (const CLI::App* command : shown_subcommands(app)) {
    absl::StrAppend(&script, "complete -c tessera -f -n __fish_use_subcommand -a ",
                    command->get_name(), " -d '", fish_text(command->get_description()), "'\n");
  }
  absl::StrAppend(&script, fish_options(app, "__fish_use_subcommand"));
  for (const CLI::App* command : shown_subcommands(app)) {
    absl::StrAppend(&script,
                    fish_options(*command, "__fish_seen_subcommand_from " + command->get_name()));
  }
  return script;
}

struct CompletionOptions {
  std::string shell;
};

}  // namespace

std::string completion_script(const CLI::App& app, const std::string& shell) {
  if (shell == "bash") return bash_script(app);
  if (shell == "zsh") return zsh_script(app);
  if (shell == "fish") return fish_script(app);
  return "";
}

void add_completion_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<CompletionOptions>();
  CLI::App* command =
      cli::add_command(app, "completion", "Print the completion script for a shell");
  command->add_option("shell", options->shell, "Shell: bash, zsh or fish")
      ->required()
      ->check(CLI::IsMember({"bash", "zsh", "fish"}));
  command->footer(
      "Examples:\n  source <(tessera completion bash)\n"
      "  tessera completion fish > ~/.config/fish/completions/tessera.fish");
  command->callback([options, &app, &invocation] {
    invocation.run = [options, &app] {
      std::fputs(completion_script(app, options->shell).c_str(), stdout);
      return kExitDone;
    };
  });
}

}  // namespace tessera::client
