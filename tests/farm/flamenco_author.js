// A stub of what Flamenco's Manager gives a job compiler script: `node flamenco_author.js SCRIPT SETTINGS` prints the job as JSON.
// As in the Manager, a task is copied when it is added: what is changed afterwards is lost.

const fs = require("fs");
const vm = require("vm");

class Task {
    constructor(name, type) {
        if (!name.trim() || !type.trim()) throw new Error("author.Task(name, type): both are required");
        Object.assign(this, { name, type, commands: [], dependencies: [] });
    }
    addCommand(command) { this.commands.push({ ...command }); }
    addDependency(task) { this.dependencies.push(task.name); }
}

function frameChunker(range, size) {
    if (!range.trim() || size < 1) throw new Error(`invalid range or chunk size: ${range}, ${size}`);
    const frames = new Set();
    for (const part of range.replaceAll("..", "-").split(",")) {
        const [first, last] = part.split("-").map((text) => {
            if (!/^\s*\d+\s*$/.test(text)) throw new Error(`invalid range ${part}`);
            return Number(text);
        });
        for (let n = first; n <= (last === undefined ? first : last); n++) frames.add(n);
    }
    const sorted = [...frames].sort((a, b) => a - b);
    const chunks = [];
    for (let k = 0; k < sorted.length; k += size) chunks.push(merged(sorted.slice(k, k + size)));
    return chunks;
}

function merged(frames) {
    const runs = [];
    for (const n of frames) {
        const run = runs[runs.length - 1];
        if (run && n === run[1] + 1) run[1] = n;
        else runs.push([n, n]);
    }
    return runs.map(([a, b]) => (a === b ? `${a}` : b === a + 1 ? `${a},${b}` : `${a}-${b}`)).join(",");
}

const [script, given] = process.argv.slice(2);
const world = {
    author: {
        Task: (name, type) => new Task(name, type),
        Command: (name, parameters, totalStepCount = 0) => ({ name, parameters, totalStepCount }),
    },
    frameChunker,
    shellSplit: (text) => text.match(/"[^"]*"|\S+/g).map((word) => word.replaceAll('"', "")),
    print: () => {},
};
vm.createContext(world);
vm.runInContext(fs.readFileSync(script, "utf8") + "\nthis.JOB_TYPE = JOB_TYPE; this.compileJob = compileJob;", world);

const defaults = Object.fromEntries(world.JOB_TYPE.settings.map((one) => [one.key, one.default]));
const job = { settings: { ...defaults, ...JSON.parse(given) }, tasks: [] };
job.addTask = (task) => job.tasks.push(JSON.parse(JSON.stringify(task)));
world.compileJob(job);
console.log(JSON.stringify({ type: world.JOB_TYPE, tasks: job.tasks }));
