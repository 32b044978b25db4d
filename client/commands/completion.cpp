#include "client/commands/completion.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "client/commands/commands.h"

namespace tessera::client {
namespace {

/// Options of a command that --help shows, with their names as they are typed.
struct ShownOption {
  std::vector<std::string> names;  // "-o", "--output"
  std::string description;
  bool takes_value = false;
  bool takes_folder = false;
};

std::vector<ShownOption> shown_options(const CLI::App& app) {
  std::vector<ShownOption> shown;
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty() || option->get_positional()) continue;
    ShownOption one;
    for (const std::string& name : option->get_snames()) one.names.push_back("-" + name);
    for (const std::string& name : option->get_lnames()) one.names.push_back("--" + name);
    one.description = option->get_description();
    one.takes_value = option->get_items_expected_max() > 0;
    one.takes_folder = option->get_type_name() == "DIR";
    if (!one.names.empty()) shown.push_back(std::move(one));
  }
  return shown;
}

std::vector<const CLI::App*> subcommands(const CLI::App& app) {
  return app.get_subcommands([](const CLI::App* each) { return !each->get_group().empty(); });
}

std::string all_names(const CLI::App& app) {
  std::vector<std::string> words;
  for (const ShownOption& option : shown_options(app)) {
    words.insert(words.end(), option.names.begin(), option.names.end());
  }
  return absl::StrJoin(words, " ");
}

std::string command_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : subcommands(app)) names.push_back(command->get_name());
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
  for (const CLI::App* command : subcommands(app)) {
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
      const char* value = !option.takes_value   ? ""
                          : option.takes_folder ? ":folder:_files -/"
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
      "# zsh completion of tessera: put it as _tessera into a folder of $fpath\n"
      "_tessera() {\n"
      "  local -a commands\n"
      "  commands=(\n";
  for (const CLI::App* command : subcommands(app)) {
    absl::StrAppend(&script, "    '", command->get_name(), ":",
                    zsh_text(command->get_description()), "'\n");
  }
  absl::StrAppend(&script, "  )\n  _arguments -C", zsh_options(app, "    "),
                  " \\\n    '1:command:->command' '*::argument:->argument'\n"
                  "  case \"$state\" in\n"
                  "    command) _describe command commands ;;\n"
                  "    argument)\n"
                  "      case \"$words[1]\" in\n");
  for (const CLI::App* command : subcommands(app)) {
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
    absl::StrAppend(&text, option.takes_value ? " -r" : "", " -d '", fish_text(option.description),
                    "'\n");
  }
  return text;
}

std::string fish_script(const CLI::App& app) {
  std::string script =
      "# fish completion of tessera: put it into ~/.config/fish/completions/tessera.fish\n";
  for (const CLI::App* command : subcommands(app)) {
    absl::StrAppend(&script, "complete -c tessera -f -n __fish_use_subcommand -a ",
                    command->get_name(), " -d '", fish_text(command->get_description()), "'\n");
  }
  absl::StrAppend(&script, fish_options(app, "__fish_use_subcommand"));
  for (const CLI::App* command : subcommands(app)) {
    absl::StrAppend(&script,
                    fish_options(*command, "__fish_seen_subcommand_from " + command->get_name()));
  }
  return script;
}

/// Text as roff shows it unchanged: backslashes, hyphens, and leading dots escaped.
std::string roff_text(const std::string& text) {
  std::string escaped = absl::StrReplaceAll(text, {{"\\", "\\e"}, {"-", "\\-"}});
  escaped = absl::StrReplaceAll(escaped, {{"\n.", "\n\\&."}, {"\n'", "\n\\&'"}});
  return !escaped.empty() && (escaped[0] == '.' || escaped[0] == '\'') ? "\\&" + escaped : escaped;
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

std::string man_page(const CLI::App& command, const std::string& program) {
  const std::string name = absl::StrReplaceAll(program, {{" ", "-"}});
  std::string page =
      absl::StrCat(".TH \"", name, "\" 1 \"\" \"tessera\" \"Tessera manual\"\n", ".SH NAME\n",
                   roff_text(name), " \\- ", roff_text(command.get_description()), "\n");
  std::string positionals;
  for (const CLI::Option* option : command.get_options()) {
    if (!option->get_positional()) continue;
    const std::string word = "\\fI" + roff_text(option->get_name(true)) + "\\fR";
    absl::StrAppend(&positionals, " ", option->get_required() ? word : "[" + word + "]");
  }
  absl::StrAppend(&page, ".SH SYNOPSIS\n.B ", roff_text(program), "\n[options]", positionals,
                  subcommands(command).empty() ? "" : " \\fIcommand\\fR", "\n");
  if (!subcommands(command).empty()) {
    absl::StrAppend(&page, ".SH COMMANDS\n");
    for (const CLI::App* each : subcommands(command)) {
      absl::StrAppend(&page, ".TP\n.B ", roff_text(each->get_name()), "\n",
                      roff_text(each->get_description()), "\n");
    }
  }
  absl::StrAppend(&page, ".SH OPTIONS\n");
  for (const CLI::Option* option : command.get_options()) {
    if (!option->get_positional()) continue;
    absl::StrAppend(&page, ".TP\n.I ", roff_text(option->get_name(true)), "\n",
                    roff_text(option->get_description()), "\n");
  }
  for (const ShownOption& option : shown_options(command)) {
    absl::StrAppend(&page, ".TP\n.B ", roff_text(absl::StrJoin(option.names, ", ")),
                    option.takes_value ? " \\fIvalue\\fR" : "", "\n", roff_text(option.description),
                    "\n");
  }
  if (!command.get_footer().empty()) {
    absl::StrAppend(&page, ".SH NOTES\n.nf\n", roff_text(command.get_footer()), "\n.fi\n");
  }
  absl::StrAppend(&page,
                  ".SH EXIT STATUS\n"
                  "0 done; 1 job failed or cancelled, or a comparison over its limit; 2 wrong "
                  "usage or bad input; 3 farm not reachable, or it refused; 130 interrupted.\n");
  return page;
}

std::string man_page_of_help(const std::string& name, const std::string& help) {
  const std::string first_line = help.substr(0, help.find('\n'));
  return absl::StrCat(".TH \"", name, "\" 1 \"\" \"tessera\" \"Tessera manual\"\n.SH NAME\n",
                      roff_text(name), " \\- ", roff_text(first_line), "\n.SH DESCRIPTION\n.nf\n",
                      roff_text(help), "\n.fi\n");
}

void add_completion_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<CompletionOptions>();
  CLI::App* command = app.add_subcommand("completion", "Print a shell's completion script");
  command->add_option("shell", options->shell, "bash, zsh or fish")
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
