// Checks Kubernetes manifests against the schemas of current API versions:
//
//   check_manifests.mjs FILE.yaml…     prints a line per object; status 1 if one is invalid
//
// Run it in a directory where the packages of package.json are installed. Their validators find wrong
// types and missing fields but ignore unknown ones. A validator reads every field that it knows, so it
// is given proxies that record what is read; a field that was not read is misspelt.
import {createRequire} from 'node:module';
import {readFileSync} from 'node:fs';

const require = createRequire(`${process.cwd()}/`);
const YAML = require('yaml');

// The model of a kind; "apps/v1" and "v1" are directories of the package.
function modelOf({apiVersion, kind}) {
  return require(`kubernetes-models/${apiVersion}/${kind}`)[kind];
}

// Returns a proxy of `value` that calls `note(path)` when a member is read, at any depth.
function recording(value, note, path = '') {
  if (value === null || typeof value !== 'object') return value;
  return new Proxy(value, {
    get(target, key) {
      if (typeof key !== 'string' || !Object.hasOwn(target, key)) return target[key];
      note(`${path}/${key}`);
      return recording(target[key], note, `${path}/${key}`);
    },
  });
}

// Yields the path of each member of `value` that is not in `read`, without the members below it.
function* unread(value, read, path = '') {
  if (value === null || typeof value !== 'object') return;
  for (const key of Object.keys(value)) {
    const here = `${path}/${key}`;
    if (read.has(here)) yield* unread(value[key], read, here);
    else yield here;
  }
}

function faultOf(object) {
  const read = new Set();
  try {
    modelOf(object).prototype.validate.call(recording(object, (path) => read.add(path)));
  } catch (error) {
    return String(error.message).slice(0, 300);
  }
  const unknown = [...unread(object, read)];
  return unknown.length > 0 ? `unknown: ${unknown.join(', ')}` : '';
}

let count = 0;
let faults = 0;
for (const file of process.argv.slice(2)) {
  for (const document of YAML.parseAllDocuments(readFileSync(file, 'utf8'), {uniqueKeys: true})) {
    const object = document.errors.length > 0 ? null : document.toJS();
    if (object === null && document.errors.length === 0) continue;
    // Kustomize breaks base64 into lines; Kubernetes accepts that, the pattern of the schema does not.
    for (const key of Object.keys(object?.kind === 'Secret' ? object.data : {})) {
      object.data[key] = object.data[key].replaceAll('\n', '');
    }
    const fault = object === null ? document.errors[0].message : faultOf(object);
    console.log(`${file}: ${object?.kind} ${object?.metadata?.name}: ${fault || 'valid'}`);
    count += 1;
    if (fault) faults += 1;
  }
}
process.exit(count === 0 || faults > 0 ? 1 : 0);
