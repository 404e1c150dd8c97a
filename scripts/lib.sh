# Shared by demo and test; source it with the project's root as working directory.

say() { printf '%s\n' "$*" >&2; }

# Installs what scripts/packages lists and this machine lacks. Calls apt-get only when something is missing.
install_packages() {
  if ! command -v dpkg-query >/dev/null; then
    say "no dpkg here: see scripts/packages for what must be installed"
    return 0
  fi
  local wanted=() missing=() package
  mapfile -t wanted < <(grep -Ev '^[[:space:]]*(#|$)' scripts/packages)
  for package in "${wanted[@]}"; do
    if [[ "$(dpkg-query -W -f='${db:Status-Status}\n' "$package" 2>/dev/null | head -n 1)" != installed ]]; then
      missing+=("$package")
    fi
  done
  ((${#missing[@]})) || return 0

  local as_root=()
  if ((EUID != 0)); then
    if ! command -v sudo >/dev/null; then
      say "error: not root and no sudo; install these first: ${missing[*]}"
      return 1
    fi
    as_root=(sudo)
  fi
  say "installing ${#missing[@]} packages: ${missing[*]}"
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get update -q </dev/null >&2
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "${missing[@]}" </dev/null >&2
}

# Configures and builds a preset; does nothing that is up to date.
build_preset() {
  cmake --preset "$1" --log-level=WARNING "${@:2}" >&2
  cmake --build --preset "$1" >&2
}
