#!/usr/bin/env python3
"""Translates the PTX of kernels into C++ that runs on the CPU, instruction by instruction.

    ptx_to_cpp.py [--count] OUT.cpp IN.ptx...

--count: for one IN.ptx, with counts of what its kernels do (tests/gpu/ptx_counts.h).

Each kernel becomes a function that tests/gpu/ptx_semantics.h runs for one lane of a warp at a time: registers are typed
locals, branches are gotos, and at an instruction that concerns other lanes (vote, shfl, bar.warp) a lane keeps the
registers that are live and returns, until all lanes have come there. Inputs that differ in their target alone are
translated once.

An instruction that is unknown, may round differently from the CPU (fused, contracted, approximate, flushing to zero) or
is not understood is a refusal: it is named in OUT's list of refusals, which a test wants empty, and throws when it runs.
"""
import re
import sys

C_TYPES = {"pred": "bool", "u8": "uint8_t", "s8": "int8_t", "b8": "uint8_t", "u16": "uint16_t", "s16": "int16_t",
           "b16": "uint16_t", "u32": "uint32_t", "s32": "int32_t", "b32": "uint32_t", "u64": "uint64_t",
           "s64": "int64_t", "b64": "uint64_t", "f32": "float", "f64": "double"}
SIZES = {t: 1 if t == "pred" else int(t[1:]) // 8 for t in C_TYPES}
ROUNDINGS = {"rni": "nearest", "rzi": "zero", "rmi": "down", "rpi": "up"}
SPECIALS = {"%tid.x": "s.thread", "%ctaid.x": "s.block", "%ntid.x": "32u", "%nctaid.x": "s.blocks",
            "%laneid": "s.thread"}
SHUFFLES = {"bfly": "shuffle_xor", "up": "shuffle_up", "down": "shuffle_down", "idx": "shuffle_index"}
VOTES = {"ballot": "ballot", "any": "any", "all": "all"}


class Refusal(Exception):
    """An instruction that has no exact translation here."""


def is_float(t):
    return t in ("f32", "f64")


def is_signed(t):
    return t[0] == "s"


class Instruction:
    def __init__(self, text):
        self.text = text
        match = re.fullmatch(r"(?:@(!?)(%\w+)\s+)?([a-z][\w.:]*)\s*(.*)", text, re.S)
        if not match:
            raise ValueError("cannot parse: " + text)
        self.negated, self.guard = match.group(1) == "!", match.group(2)
        self.opcode = match.group(3)
        self.parts = self.opcode.split(".")
        self.operands = split_operands(match.group(4))

    @property
    def type(self):
        return self.parts[-1]


def split_operands(text):
    """Splits at commas outside of braces and brackets."""
    operands, depth, start = [], 0, 0
    for i, c in enumerate(text):
        depth += (c in "{[") - (c in "}]")
        if c == "," and depth == 0:
            operands.append(text[start:i].strip())
            start = i + 1
    rest = text[start:].strip()
    return operands + [rest] if rest else operands


def elements(operand):
    """The registers of {a, b}, or of a single one."""
    return [e.strip() for e in operand[1:-1].split(",")] if operand.startswith("{") else [operand]


# What a half of a register goes to that is not wanted, in a block of its own.
UNWANTED_HALF = re.compile(r"\{\s*\.reg\s+\.b32\s+tmp;\s*(mov\.b64\s+\{[^}]*\}[^;]*;)\s*\}")


class Kernel:
    def __init__(self, name, parameters, body):
        self.name = name
        self.counts = False
        match = re.fullmatch(r"\s*\.param\s+\.align\s+(\d+)\s+\.b8\s+(\w+)\[(\d+)\]\s*", parameters)
        if not match:
            raise ValueError(f"{name}: one structure is wanted as the parameter, not {parameters.strip()}")
        self.parameter, self.parameter_bytes = match.group(2), int(match.group(3))
        self.registers, self.local_bytes, self.local_name = {}, 0, None
        self.lines = []  # Instruction or label
        body, blocks = UNWANTED_HALF.subn(lambda m: re.sub(r"\btmp\b", "%unwanted", m.group(1)), body)
        if blocks:
            self.registers["%unwanted"] = "b32"
        for statement in statements(body):
            self.add(statement)
        self.refusals = []

    def add(self, statement):
        register = re.fullmatch(r"\.reg\s+\.(\w+)\s+(%\w+?)(?:<(\d+)>)?", statement)
        local = re.fullmatch(r"\.local\s+\.align\s+(\d+)\s+\.b8\s+(\w+)\[(\d+)\]", statement)
        if register:
            type_, name, count = register.groups()
            names = [f"{name}{i}" for i in range(int(count))] if count else [name]
            self.registers.update({n: type_ for n in names})
        elif local:
            self.local_name, self.local_bytes = local.group(2), int(local.group(3))
        elif statement.endswith(":"):
            self.lines.append(statement[:-1])
        elif statement.startswith("."):
            if statement.split()[0] not in (".loc", ".pragma"):
                raise ValueError(f"{self.name}: {statement}")
        else:
            self.lines.append(Instruction(statement))

    # ---- operands

    def cpp_name(self, register):
        if register not in self.registers:
            raise Refusal("unknown register " + register)
        return register[1:].replace("$", "_")

    def read(self, operand, type_):
        """The operand as a value of PTX's type."""
        c = C_TYPES[type_]
        if operand in SPECIALS:
            return f"get<{c}>({SPECIALS[operand]})"
        if operand.startswith("%"):
            if type_ == "pred":
                return self.cpp_name(operand)
            return f"get<{c}>({self.cpp_name(operand)})"
        if operand in (self.parameter, self.local_name):
            return "s.arguments" if operand == self.parameter else "std::bit_cast<uint64_t>(&s.local[0])"
        for prefix, function, digits in (("0f", "float_of", 8), ("0F", "float_of", 8),
                                         ("0d", "double_of", 16), ("0D", "double_of", 16)):
            if operand.startswith(prefix) and len(operand) == 2 + digits:
                return f"get<{c}>({function}(0x{operand[2:]}u{'ll' if digits == 16 else ''}))"
        if re.fullmatch(r"-?(0x[0-9A-Fa-f]+|\d+)U?", operand):
            value = int(operand.rstrip("U"), 0)
            if type_ == "pred":
                return "true" if value else "false"
            bits = 64 if is_float(type_) else 8 * SIZES[type_]
            if is_float(type_):
                raise Refusal("a whole number as a float")
            return f"{c}(0x{value & (1 << bits) - 1:x}u{'ll' if bits == 64 else ''})"
        raise Refusal("operand " + operand)

    def write(self, operand, value):
        if operand == "_":
            return f"(void)({value});"
        if self.registers.get(operand) == "pred":
            return f"{self.cpp_name(operand)} = {value};"
        name = self.cpp_name(operand)
        return f"{name} = put<{C_TYPES[self.registers[operand]]}>({value});"

    def address(self, operand):
        match = re.fullmatch(r"\[\s*([%\w$]+)\s*(?:\+\s*(-?\d+))?\s*\]", operand)
        if not match:
            raise Refusal("address " + operand)
        return f"{self.read(match.group(1), 'u64')} + uint64_t({int(match.group(2) or 0)}ll)"

    # ---- instructions

    def translate(self, i, stop):
        """C++ of one instruction. stop: number of its exchange among lanes, or None."""
        base, mods, t, ops = i.parts[0], i.parts[1:], i.type, i.operands
        for mod, why in (("approx", "approximate"), ("ftz", "flushes to zero"), ("full", "approximate")):
            if mod in mods:
                raise Refusal(why)
        if base in ("fma", "mad", "mad24") and (base == "fma" or is_float(t)):
            raise Refusal("a fused multiply-add")
        if is_float(t) and base in ("add", "sub", "mul", "div", "sqrt", "rcp") and mods != ["rn", t]:
            raise Refusal("not rounded to nearest, or free to be contracted")
        if stop is not None:
            return self.exchange(i, stop)
        handler = getattr(self, "op_" + base, None)
        code = handler(i, base, mods, t, ops) if handler else None
        if code is None:
            raise Refusal("unknown")
        return code

    def binary(self, i, t, function, ops=None):
        d, a, b = ops or i.operands
        c = C_TYPES[t]
        return self.write(d, f"{function}<{c}>({self.read(a, t)}, {self.read(b, t)})")

    def wrapped(self, t, expression):
        return f"wrap<{C_TYPES[t]}>({expression})"

    def wide(self, operand, t):
        return f"uint64_t({self.read(operand, t)})"

    def op_add(self, i, base, mods, t, ops):
        if is_float(t):
            return self.binary(i, t, base)
        if mods != [t]:
            return None
        sign = {"add": "+", "sub": "-", "mul": "*"}[base]
        return self.write(ops[0], self.wrapped(t, f"{self.wide(ops[1], t)} {sign} {self.wide(ops[2], t)}"))

    op_sub = op_add

    def op_mul(self, i, base, mods, t, ops):
        if is_float(t):
            return self.binary(i, t, "mul")
        return self.product(mods, t, ops, None)

    def op_mad(self, i, base, mods, t, ops):
        return self.product(mods, t, ops[:3], ops[3])

    def product(self, mods, t, ops, addend):
        d, a, b = ops
        if mods == ["lo", t]:
            result, value = t, f"{self.wide(a, t)} * {self.wide(b, t)}"
        elif mods == ["wide", t] and SIZES[t] < 8:
            result = t[0] + str(16 * SIZES[t])
            wide = C_TYPES[result]
            value = f"uint64_t({wide}({self.read(a, t)}) * {wide}({self.read(b, t)}))"
        elif mods == ["hi", t] and SIZES[t] == 4:
            result, value = t, f"uint64_t(high_product<{C_TYPES[t]}>({self.read(a, t)}, {self.read(b, t)}))"
        else:
            return None
        if addend is not None:
            value += " + " + self.wide(addend, result)
        return self.write(d, self.wrapped(result, value))

    def op_div(self, i, base, mods, t, ops):
        if is_float(t):
            return self.binary(i, t, "div")
        return self.binary(i, t, "quotient") if mods == [t] else None

    def op_rem(self, i, base, mods, t, ops):
        return self.binary(i, t, "remainder") if mods == [t] and not is_float(t) else None

    def unary(self, t, ops, function):
        return self.write(ops[0], f"{function}<{C_TYPES[t]}>({self.read(ops[1], t)})")

    def op_sqrt(self, i, base, mods, t, ops):
        return self.unary(t, ops, "root")

    def op_rcp(self, i, base, mods, t, ops):
        return self.unary(t, ops, "reciprocal")

    def op_abs(self, i, base, mods, t, ops):
        if mods != [t]:
            return None
        if is_float(t):
            return self.unary(t, ops, "absolute")
        a = self.read(ops[1], t)
        return self.write(ops[0], self.wrapped(t, f"{a} < 0 ? 0 - uint64_t({a}) : uint64_t({a})"))

    def op_neg(self, i, base, mods, t, ops):
        if mods != [t]:
            return None
        if is_float(t):
            return self.unary(t, ops, "negative")
        return self.write(ops[0], self.wrapped(t, f"0 - {self.wide(ops[1], t)}"))

    def op_min(self, i, base, mods, t, ops):
        if mods != [t]:
            return None
        if is_float(t):
            return self.binary(i, t, base + "imum")
        a, b = self.read(ops[1], t), self.read(ops[2], t)
        less = "<" if base == "min" else ">"
        return self.write(ops[0], f"({a} {less} {b} ? {a} : {b})")

    def op_max(self, i, base, mods, t, ops):
        return self.op_min(i, base, mods, t, ops)

    def op_copysign(self, i, base, mods, t, ops):
        return self.binary(i, t, "copy_sign") if mods == [t] else None

    def op_and(self, i, base, mods, t, ops):
        sign = {"and": "&", "or": "|", "xor": "^"}[base]
        if mods != [t]:
            return None
        c = "bool" if t == "pred" else C_TYPES[t]
        return self.write(ops[0], f"{c}({self.read(ops[1], t)} {sign} {self.read(ops[2], t)})")

    op_or = op_xor = op_and

    def op_not(self, i, base, mods, t, ops):
        if mods != [t]:
            return None
        sign = "!" if t == "pred" else "~"
        return self.write(ops[0], f"{C_TYPES[t]}({sign}{self.read(ops[1], t)})")

    def op_shl(self, i, base, mods, t, ops):
        if mods != [t]:
            return None
        function = "shift_left" if base == "shl" else "shift_right"
        return self.write(ops[0], f"{function}<{C_TYPES[t]}>({self.read(ops[1], t)}, {self.read(ops[2], 'u32')})")

    op_shr = op_shl

    def op_shf(self, i, base, mods, t, ops):
        if len(mods) != 3 or t != "b32":
            return None
        left, wraps = mods[0] == "l", mods[1] == "wrap"
        a, b, amount = (self.read(o, "b32") for o in ops[1:])
        return self.write(ops[0], f"funnel({str(left).lower()}, {str(wraps).lower()}, {a}, {b}, {amount})")

    def op_bfe(self, i, base, mods, t, ops):
        if mods != [t]:
            return None
        c, a = C_TYPES[t], self.read(ops[1], t)
        return self.write(ops[0], f"extract_bits<{c}>({a}, {self.read(ops[2], 'u32')}, {self.read(ops[3], 'u32')})")

    def op_bfi(self, i, base, mods, t, ops):
        if mods != [t]:
            return None
        c, a, b = C_TYPES[t], self.read(ops[1], t), self.read(ops[2], t)
        return self.write(ops[0], f"insert_bits<{c}>({a}, {b}, {self.read(ops[3], 'u32')}, {self.read(ops[4], 'u32')})")

    def op_prmt(self, i, base, mods, t, ops):
        if mods != ["b32"]:
            return None
        return self.write(ops[0], f"permute({', '.join(self.read(o, 'b32') for o in ops[1:])})")

    def op_popc(self, i, base, mods, t, ops):
        function = {"popc": "count_bits", "clz": "leading_zeros"}[base]
        return self.unary(t, ops, function) if mods == [t] else None

    op_clz = op_popc

    def op_brev(self, i, base, mods, t, ops):
        return self.write(ops[0], f"reversed({self.read(ops[1], 'b32')})") if mods == ["b32"] else None

    def op_setp(self, i, base, mods, t, ops):
        if len(mods) != 2 or len(ops) != 3 or "|" in ops[0]:
            return None
        relation = mods[0]
        a, b = self.read(ops[1], t), self.read(ops[2], t)
        signs = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">=",
                 "lo": "<", "ls": "<=", "hi": ">", "hs": ">="}
        unordered = is_float(t) and relation.endswith("u") and relation != "num"
        if unordered:
            relation = relation[:-1]
        if is_float(t) and relation in ("num", "nan"):
            value = f"is_nan({a}) || is_nan({b})"
            return self.write(ops[0], f"!({value})" if relation == "num" else f"({value})")
        if relation not in signs:
            return None
        value = f"{a} {signs[relation]} {b}"
        if unordered:
            value = f"is_nan({a}) || is_nan({b}) || {value}"
        elif is_float(t) and relation == "ne":
            value = f"!is_nan({a}) && !is_nan({b}) && {value}"
        return self.write(ops[0], f"({value})")

    def op_selp(self, i, base, mods, t, ops):
        if mods != [t]:
            return None
        return self.write(ops[0], f"({self.read(ops[3], 'pred')} ? {self.read(ops[1], t)} : {self.read(ops[2], t)})")

    def op_mov(self, i, base, mods, t, ops):
        if mods != [t]:
            return None
        to, source = elements(ops[0]), elements(ops[1])
        if len(to) == 1 and len(source) == 1:
            return self.write(to[0], self.read(source[0], t))
        count = max(len(to), len(source))
        part = f"b{8 * SIZES[t] // count}"
        if part not in C_TYPES:
            return None
        bits = 8 * SIZES[part]
        if len(to) == 1:
            value = " | ".join(f"uint64_t({self.read(e, part)}) << {bits * n}" for n, e in enumerate(source))
            return self.write(to[0], f"{C_TYPES[t]}({value})")
        whole = self.read(source[0], t)
        return (f"{{ const {C_TYPES[t]} whole = {whole}; " +
                " ".join(self.write(e, f"{C_TYPES[part]}(whole >> {bits * n})") for n, e in enumerate(to)) + " }")

    def op_cvta(self, i, base, mods, t, ops):
        # Addresses of every space are those of this process.
        spaces = [m for m in mods if m in ("global", "local", "param", "const")]
        return self.write(ops[0], self.read(ops[1], t)) if len(spaces) == 1 and t == "u64" else None

    def op_cvt(self, i, base, mods, t, ops):
        if len(mods) < 2:
            return None
        to, source, rest = mods[-2], mods[-1], mods[:-2]
        if to not in C_TYPES or source not in C_TYPES:
            return None
        a, c = self.read(ops[1], source), C_TYPES[to]
        if len(rest) > 1:
            return None
        how = rest[0] if rest else None
        if not is_float(to) and not is_float(source) and how is None:
            return self.write(ops[0], f"{c}({a})")
        if is_float(to) and not is_float(source) and how == "rn":
            return self.write(ops[0], f"{c}({a})")
        if is_float(to) and is_float(source):
            if to == source and how in ROUNDINGS:
                return self.write(ops[0], f"round_to_whole<Rounding::{ROUNDINGS[how]}>({a})")
            if (to, source, how) in (("f64", "f32", None), ("f32", "f64", "rn")):
                return self.write(ops[0], f"canonical({c}({a}))")
        if not is_float(to) and is_float(source) and how in ROUNDINGS and SIZES[to] >= 4:
            return self.write(ops[0], f"to_whole<{c}, Rounding::{ROUNDINGS[how]}>({a})")
        return None

    def op_ld(self, i, base, mods, t, ops):
        rest = [m for m in mods[:-1] if m not in ("global", "param", "local", "const", "nc", "v2", "v4")]
        if rest:
            return None
        count = next((int(m[1]) for m in mods if m in ("v2", "v4")), 1)
        registers = elements(ops[0] if base == "ld" else ops[1])
        memory = ops[1] if base == "ld" else ops[0]
        if len(registers) != count:
            return None
        c, name, size = C_TYPES[t], f'"{self.name}: {i.opcode}"', SIZES[t]
        code = [f"{{ const uint64_t at = {self.address(memory)};"]
        if count > 1:
            code.append(f"require_aligned(at, {size * count}, {name});")
        if self.counts and "global" in mods:
            code.append(f"s.touch({self.lines.index(i)}, at);")
        if base == "ld":
            # All words are read before a register of the address is written; `at` is a copy.
            code += [self.write(r, f"load<{c}>(at + {size * n}, {name})") for n, r in enumerate(registers)]
        else:
            code += [f"store<{c}>(at + {size * n}, {self.read(r, t)}, {name});" for n, r in enumerate(registers)]
        return " ".join(code) + " }"

    op_st = op_ld

    def op_bra(self, i, base, mods, t, ops):
        return f"goto {label_name(ops[0])};"

    def op_ret(self, i, base, mods, t, ops):
        return "{ s.at = Lane::k_exited; return; }" if not mods else None

    op_exit = op_ret

    def exchange(self, i, stop):
        base, mods, ops = i.parts[0], i.parts[1:], i.operands
        keep = sorted(self.live_across[id(i)])
        code = [f"s.kept_{self.cpp_name(r)} = {self.cpp_name(r)};" for r in keep]
        after = []
        if base == "vote" and len(mods) == 3 and mods[0] == "sync" and mods[1] in VOTES:
            op, mask = VOTES[mods[1]], ops[2]
            value = ops[1]
            negated = value.startswith("!")
            code.append(f"s.value = {'!' if negated else ''}{self.read(value.lstrip('!'), 'pred')};")
            after.append(self.write(ops[0], "s.result != 0" if mods[2] == "pred" else "s.result"))
        elif base == "shfl" and len(mods) == 3 and mods[0] == "sync" and mods[1] in SHUFFLES and mods[2] == "b32":
            op, mask = SHUFFLES[mods[1]], ops[4]
            to = ops[0].split("|")
            code += [f"s.value = {self.read(ops[1], 'b32')};", f"s.operand = {self.read(ops[2], 'b32')};",
                     f"s.clamp = {self.read(ops[3], 'b32')};"]
            after.append(self.write(to[0], "s.result"))
            after += [self.write(p, "s.in_range") for p in to[1:]]
        elif base == "bar" and mods == ["warp", "sync"]:
            op, mask = "barrier", ops[0]
        else:
            raise Refusal("unknown")
        code += [f"s.op = WarpOp::{op};", f"s.mask = {self.read(mask, 'b32')};", f"s.at = {stop};", "return;",
                 f"resume_{stop}:"]
        code += [f"{self.cpp_name(r)} = s.kept_{self.cpp_name(r)};" for r in keep]
        return "{ " + " ".join(code + after) + " }"

    # ---- what lives across exchanges

    def uses_and_definitions(self, i):
        def registers(text):
            return {r for r in re.findall(r"%[A-Za-z]\w*", text) if r in self.registers}

        used = {i.guard} if i.guard else set()
        defined = set()
        has_result = i.parts[0] not in ("st", "bra", "ret", "exit", "bar")
        for n, operand in enumerate(i.operands):
            if n == 0 and has_result:
                defined |= registers(operand)
            else:
                used |= registers(operand)
        return used, defined

    def find_live(self):
        """For each exchange: the registers that are read after it and not written by it."""
        labels = {line: n for n, line in enumerate(self.lines) if isinstance(line, str)}
        facts = []
        for n, line in enumerate(self.lines):
            after = [n + 1] if n + 1 < len(self.lines) else []
            used, defined = set(), set()
            if isinstance(line, Instruction):
                used, defined = self.uses_and_definitions(line)
                if line.guard:
                    used = used | defined  # may keep its old value
                    defined = set()
                if line.parts[0] in ("ret", "exit", "bra") and not line.guard:
                    after = []
                if line.parts[0] == "bra":
                    after = after + [labels[line.operands[0]]]
            facts.append((used, defined, after))
        live = [set() for _ in self.lines]
        changed = True
        while changed:
            changed = False
            for n in range(len(self.lines) - 1, -1, -1):
                used, defined, after = facts[n]
                out = set().union(*(live[k] for k in after)) if after else set()
                new = used | (out - defined)
                if new != live[n]:
                    live[n], changed = new, True
        self.live_across = {}
        for n, line in enumerate(self.lines):
            if is_exchange(line):
                used, defined, after = facts[n]
                out = set().union(*(live[k] for k in after)) if after else set()
                self.live_across[id(line)] = out - defined

    def to_cpp(self):
        self.find_live()
        stops = [line for line in self.lines if is_exchange(line)]
        numbers = {id(line): n + 1 for n, line in enumerate(stops)}
        kept = sorted(set().union(*self.live_across.values())) if stops else []
        code = [f"struct {self.name}_lane : {'CountedLane' if self.counts else 'Lane'} {{"]
        code += [f"  {C_TYPES[self.registers[r]]} kept_{self.cpp_name(r)};" for r in kept]
        if self.local_bytes:
            code.append(f"  alignas(16) unsigned char local[{self.local_bytes}];")
        if self.counts:
            code.append(f"  uint32_t runs[{len(self.lines) + 1}] = {{}};")
        code += ["};", f"void run_{self.name}({self.name}_lane& s) {{"]
        used = set()
        for line in self.lines:
            if isinstance(line, Instruction):
                a, b = self.uses_and_definitions(line)
                used |= a | b
        code += [f"  {C_TYPES[self.registers[r]]} {self.cpp_name(r)};" for r in sorted(used)]
        code.append("  switch (s.at) {")
        code += [f"    case {n}: goto resume_{n};" for n in numbers.values()] + ["    default: break;", "  }"]
        targets = {line.operands[0] for line in self.lines if isinstance(line, Instruction) and line.parts[0] == "bra"}
        self.block_sizes, starts_block = [], True
        for line in self.lines:
            if isinstance(line, str):
                if line in targets:
                    code.append(f"{label_name(line)}:;")
                    starts_block = True
                continue
            if starts_block:
                if self.counts:
                    code.append(f"  ++s.runs[{len(self.block_sizes)}];")
                self.block_sizes.append(0)
            self.block_sizes[-1] += 1
            starts_block = line.parts[0] in ("bra", "ret", "exit") or is_exchange(line)
            try:
                text = self.translate(line, numbers.get(id(line)))
            except Refusal as refusal:
                self.refusals.append(f"{self.name}: {line.opcode}: {refusal}")
                text = f'throw PtxFault("{self.name}: {line.opcode} was refused");'
                if id(line) in numbers:
                    text = "{ " + text + f" resume_{numbers[id(line)]}:; }}"
            if line.guard:
                text = f"if ({'!' if line.negated else ''}{self.cpp_name(line.guard)}) {{ {text} }}"
            code.append(f"  {text}  // {line.text}")
        code += ["  s.at = Lane::k_exited;", "}"]
        return "\n".join(code)


def is_exchange(line):
    return isinstance(line, Instruction) and (line.parts[0] in ("vote", "shfl") or line.parts[:2] == ["bar", "warp"])


def label_name(label):
    return re.sub(r"\W", "_", label)


def statements(body):
    """Labels with their colon, and what ends in a semicolon."""
    for line in body.split("\n"):
        line = line.strip()
        label = re.match(r"([$\w]+:)(.*)", line)
        if label and not line.startswith("@"):
            yield label.group(1)
            line = label.group(2).strip()
        while line:
            if re.match(r"\.loc\s", line):
                break
            statement, semicolon, line = line.partition(";")
            if not semicolon:
                raise ValueError("a statement of several lines: " + statement)
            if statement.strip():
                yield re.sub(r"\s+", " ", statement.strip())
            line = line.strip()


def parse(text):
    """The kernels of a PTX file."""
    text = re.sub(r"//[^\n]*|/\*.*?\*/", "", text, flags=re.S)
    kernels = []
    pattern = re.compile(r"(?:\.visible\s+)?\.entry\s+(\w+)\s*\(([^)]*)\)([^{]*)\{")
    end = 0
    rest = []
    for match in pattern.finditer(text):
        rest.append(text[end:match.start()])
        end, depth = match.end(), 1
        while depth:
            depth += {"{": 1, "}": -1}.get(text[end], 0)
            end += 1
        kernels.append(Kernel(match.group(1), match.group(2), text[match.end():end - 1]))
    rest = "".join(rest + [text[end:]])
    unread = [line.strip() for line in rest.split("\n")
              if line.strip() and not re.match(r"\s*\.(version|target|address_size)\b", line)]
    refusals = [f"outside of kernels: {line}" for line in unread]
    return kernels, refusals


def target_of(text):
    return re.search(r"^\.target\s+(\w+)", text, re.M).group(1)


def counting(path):
    """C++ of the kernels of a PTX file that count what they do."""
    text = open(path, encoding="utf-8").read()
    target, (kernels, _) = target_of(text), parse(text)
    code = ["// Made by tests/gpu/ptx_to_cpp.py --count.", '#include "tests/gpu/ptx_counts.h"',
            "", "namespace fieldtrace::ptx {", "namespace {"]
    table = []
    for kernel in kernels:
        kernel.counts = True
        code.append(kernel.to_cpp())
        sizes = ", ".join(f"{n}u" for n in kernel.block_sizes)
        code.append(f"constexpr uint32_t k_sizes_{kernel.name}[] = {{{sizes}}};")
        code.append(f"PtxCounts launch_{kernel.name}(uint32_t blocks, const void* arguments) {{\n  PtxCounts counts;\n"
                    f'  run_blocks(run_{kernel.name}, "{kernel.name}", blocks, arguments,\n'
                    f"             [&](const auto& lanes) {{ counts += count_warp(lanes, k_sizes_{kernel.name}); }});\n"
                    "  return counts;\n}")
        table.append(f'    {{"{target}", "{kernel.name}", {sum(kernel.block_sizes)}, launch_{kernel.name}}},')
    return code + ["}  // namespace", "", "const std::vector<CountingKernel>& counting_kernels() {",
                   "  static const std::vector<CountingKernel> kernels = {", *table, "  };", "  return kernels;", "}", "",
                   "}  // namespace fieldtrace::ptx", ""]


def main():
    if sys.argv[1] == "--count":
        _, _, out, path = sys.argv
        with open(out, "w", encoding="utf-8") as file:
            file.write("\n".join(counting(path)))
        return
    out, inputs = sys.argv[1], sys.argv[2:]
    variants = {}  # text without its target -> targets
    for path in inputs:
        text = open(path, encoding="utf-8").read()
        variants.setdefault(re.sub(r"^\.target.*$", "", text, flags=re.M), []).append(target_of(text))
    code = ["// Made by tests/gpu/ptx_to_cpp.py.", '#include "tests/gpu/ptx_kernels.h"',
            '#include "tests/gpu/ptx_semantics.h"', "", "namespace fieldtrace::ptx {", "namespace {"]
    table, refusals = [], []
    for n, (text, targets) in enumerate(variants.items()):
        name = "_".join(targets)
        kernels, outside = parse(text)
        refusals += [f"{name}: {r}" for r in outside]
        code.append(f"namespace variant_{n} {{")
        for kernel in kernels:
            code.append(kernel.to_cpp())
            code.append(f"void launch_{kernel.name}(uint32_t blocks, const void* arguments) {{\n"
                        f'  run_blocks(run_{kernel.name}, "{kernel.name}", blocks, arguments);\n}}')
            table.append(f'    {{{n}, "{name}", "{kernel.name}", {kernel.parameter_bytes}, '
                         f"variant_{n}::launch_{kernel.name}}},")
            refusals += [f"{name}: {r}" for r in kernel.refusals]
        code.append(f"}}  // namespace variant_{n}")
    quoted = "".join(f'    "{r}",\n' for r in dict.fromkeys(refusals)).replace("%", "%")
    code += ["}  // namespace", "", "const std::vector<PtxKernel>& ptx_kernels() {",
             "  static const std::vector<PtxKernel> kernels = {", *table, "  };", "  return kernels;", "}", "",
             "const std::vector<std::string>& ptx_refusals() {",
             "  static const std::vector<std::string> refusals = {\n" + quoted + "  };", "  return refusals;", "}", "",
             "}  // namespace fieldtrace::ptx", ""]
    with open(out, "w", encoding="utf-8") as file:
        file.write("\n".join(code))


if __name__ == "__main__":
    main()
