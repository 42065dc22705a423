/** Why the robot is stopped, for its banner. */

/** What the robot says of any stop that the console's server has combined; the server says whose it is. */
const OF_CONSOLES = "a browser of the console";

export interface StopFacts {
  /** This page's own reason; empty while it states no stop. */
  own: string;
  /** This browser's name at the server. */
  name: string;
  /** The reasons that the server gives. */
  server: readonly string[];
  /** The reasons that the robot's e-stop gives. */
  robot: readonly string[];
}

/** Every reason once: this page's own first, then those of others. */
export function stopReasons({ own, name, server, robot }: StopFacts): string[] {
  const fromServer = own === "" ? server : server.filter((reason) => !reason.startsWith(`${name} `));
  const fromRobot = own === "" && server.length === 0 ? robot : robot.filter((reason) => !reason.startsWith(OF_CONSOLES));
  return [...new Set([own, ...fromServer, ...fromRobot])].filter((reason) => reason !== "");
}
